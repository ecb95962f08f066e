/** Loudly: Stop failed, why, and what to do. On every screen on which Stop can be pressed; nothing where it did not fail. */
import { OctagonAlert, X } from "lucide-react";
import { useTranslation } from "react-i18next";
import { stopRobot } from "../../acp/connection/stop";
import { setState, useStore, type StopFailure } from "../../state/store";
import { SentenceWithQuote } from "./sentence-with-quote";
import { visibleLine } from "../../wire/visible-text";

/** `onDismiss` is called when somebody has hidden it, before it goes. */
export function StopFailed({ onDismiss }: { onDismiss?: () => void }) {
  const { t } = useTranslation();
  const failure = useStore((state) => state.stopError);
  if (failure === null) return null;
  return (
    <section className="band band-danger band-loud" data-testid="stop-failed" role="alert">
      <OctagonAlert aria-hidden />
      <p>
        <strong>
          <Words failure={failure} />
        </strong>
      </p>
      <button type="button" className="button on-danger" onClick={() => void stopRobot()}>
        {t("stop.again")}
      </button>
      <button
        type="button"
        className="icon-button"
        aria-label={t("stop.dismiss")}
        onClick={() => {
          onDismiss?.();
          setState({ stopError: null });
        }}
      >
        <X aria-hidden />
      </button>
    </section>
  );
}

function Words({ failure }: { failure: StopFailure }) {
  const { t } = useTranslation();
  switch (failure.kind) {
    case "told":
      return <span lang="en">{visibleLine(failure.sentence)}</span>;
    case "refused":
      return (
        <SentenceWithQuote
          sentence={t("stop.refused", { reason: failure.sentence })}
          quote={failure.sentence}
          lang="en"
        />
      );
    default:
      return t(`stop.${failure.kind}`);
  }
}
