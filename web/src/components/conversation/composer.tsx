/** The field to write in. Enter sends the message and never answers a question; Escape does nothing. */
import { CircleStop, SendHorizontal } from "lucide-react";
import { useLayoutEffect, useRef, type KeyboardEvent } from "react";
import { useTranslation } from "react-i18next";
import { cancelTurn, prompt } from "../../acp/sessions/sessions";
import { usePromptObstacle } from "../../hooks/use-prompt-obstacle";
import { conversationOf, robotName, useMe, useStore } from "../../state/store";
import { author, COMPOSER_ID, giveBackText, useComposerText } from "./composer-text";

export function Composer() {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  const text = useComposerText((state) => state.text);
  const turn = useStore((state) => conversationOf(state).turn);
  const reason = usePromptObstacle();
  const online = useStore((state) => state.link.status === "online");
  const field = useRef<HTMLTextAreaElement>(null);
  // As high as its text, up to the style sheet's limit.
  useLayoutEffect(() => {
    const area = field.current;
    if (area === null) return;
    area.style.height = "auto";
    area.style.height = `${area.scrollHeight}px`;
  }, [text]);

  const send = (): void => {
    if (reason !== null || text.trim() === "") return;
    useComposerText.setState({ text: "" });
    void prompt(text.trim(), me.name).then((arrived) => {
      if (!arrived && author() === me.name) giveBackText(text.trim());
    });
  };
  const onKeyDown = (event: KeyboardEvent): void => {
    if (event.key !== "Enter" || event.shiftKey || event.nativeEvent.isComposing) return;
    event.preventDefault();
    send();
  };

  return (
    <form
      className="composer"
      onSubmit={(event) => {
        event.preventDefault();
        send();
      }}
    >
      <div className="composer-box" data-off={reason === "viewer" || reason === "disconnected"}>
        <label htmlFor={COMPOSER_ID} className="sr-only">
          {t("composer.label", { robot })}
        </label>
        <textarea
          id={COMPOSER_ID}
          data-testid="composer"
          ref={field}
          rows={1}
          value={text}
          placeholder={reason === "viewer" ? "" : t("composer.placeholder", { robot })}
          disabled={reason === "viewer" || reason === "disconnected"}
          aria-describedby="composer-hint"
          onChange={(event) => useComposerText.setState({ text: event.target.value })}
          onKeyDown={onKeyDown}
        />
        <div className="composer-buttons">
          {turn !== null && reason !== "viewer" && (
            <button
              type="button"
              className="button"
              data-testid="cancel"
              disabled={turn.cancelling || !online}
              onClick={() => void cancelTurn().catch(() => undefined)}
            >
              <CircleStop aria-hidden /> {t(turn.cancelling ? "composer.stopping" : "composer.cancel")}
            </button>
          )}
          <button
            type="submit"
            className="button primary"
            data-testid="send"
            disabled={reason !== null || text.trim() === ""}
          >
            <SendHorizontal aria-hidden />
            <span className="send-word">{t("composer.send")}</span>
          </button>
        </div>
      </div>
      <p id="composer-hint" className="composer-hint" data-reason={reason ?? "none"}>
        {reason === null ? t("composer.hint") : t(`composer.${reason}`, { robot })}
      </p>
    </form>
  );
}
