/** The search field of the sessions. Escape and the cross empty it and keep the focus in it. */
import { Search, X } from "lucide-react";
import { useRef } from "react";
import { useTranslation } from "react-i18next";

export function SessionSearch({ words, onWords }: { words: string; onWords: (words: string) => void }) {
  const { t } = useTranslation();
  const field = useRef<HTMLInputElement>(null);
  return (
    <div className="search">
      <Search aria-hidden />
      <input
        ref={field}
        type="search"
        data-testid="session-search"
        aria-label={t("people.search")}
        placeholder={t("people.search")}
        value={words}
        onChange={(event) => onWords(event.target.value)}
        onKeyDown={(event) => {
          if (event.key !== "Escape" || words === "") return;
          event.preventDefault();
          event.stopPropagation(); // the drawer stays open
          onWords("");
        }}
      />
      {words !== "" && (
        <button
          type="button"
          className="icon-button search-clear"
          aria-label={t("people.clear")}
          onClick={() => {
            onWords("");
            field.current?.focus();
          }}
        >
          <X aria-hidden />
        </button>
      )}
    </div>
  );
}
