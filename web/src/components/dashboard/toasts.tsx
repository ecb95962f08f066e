/** Short notices that disappear by themselves. Nothing that needs an answer is a toast. */
import { X } from "lucide-react";
import { Toast } from "radix-ui";
import { useTranslation } from "react-i18next";
import { setState, useStore } from "../../state/store";
import { visibleLine } from "../../wire/visible-text";

export function Toasts() {
  const { t } = useTranslation();
  const toasts = useStore((state) => state.toasts);
  const dismiss = (id: number): void => {
    setState((state) => ({ toasts: state.toasts.filter((toast) => toast.id !== id) }));
  };
  return (
    <Toast.Provider duration={5000} swipeDirection="right" label={t("toast.region")}>
      {toasts.map((toast) => (
        <Toast.Root
          key={toast.id}
          className="toast"
          data-tone={toast.tone}
          onOpenChange={(open) => {
            if (!open) dismiss(toast.id);
          }}
        >
          <Toast.Description lang={toast.lang}>{visibleLine(toast.text)}</Toast.Description>
          <Toast.Close className="icon-button" aria-label={t("toast.close")}>
            <X aria-hidden />
          </Toast.Close>
        </Toast.Root>
      ))}
      <Toast.Viewport className="toasts" label={t("toast.region")} />
    </Toast.Provider>
  );
}
