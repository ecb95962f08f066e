/** The field for a request, and a microphone where the kiosk may use one. */
import { Mic, SendHorizontal } from "lucide-react";
import { useEffect, type SubmitEvent } from "react";
import { useTranslation } from "react-i18next";
import { robotName, useStore } from "../../state/store";
import { useVoice } from "./use-voice";

const LONGEST = 400;

export function AskBar(props: {
  text: string;
  onText: (text: string) => void;
  running: boolean;
  voice: boolean;
  onSend: () => void;
}) {
  const { t, i18n } = useTranslation();
  const robot = useStore(robotName);
  const online = useStore((state) => state.link.status === "online");
  const voice = useVoice(props.voice, i18n.language, props.onText);
  const { stop } = voice;
  useEffect(() => {
    if (props.running) stop();
  }, [props.running, stop]);
  const empty = props.text.trim() === "";
  if (props.running) return null;
  const submit = (event: SubmitEvent): void => {
    event.preventDefault();
    if (empty || !online) return;
    stop();
    props.onSend();
  };
  return (
    <form className="kiosk-field" onSubmit={submit}>
      <input
        aria-label={t("kiosk.field", { robot })}
        data-testid="kiosk-field"
        autoComplete="off"
        autoCorrect="off"
        spellCheck={false}
        enterKeyHint="send"
        maxLength={LONGEST}
        value={props.text}
        placeholder={t(voice.listening ? "kiosk.listening" : "kiosk.placeholder")}
        onChange={(event) => props.onText(event.target.value)}
      />
      {voice.possible && (
        <button
          type="button"
          className="button"
          data-testid="kiosk-voice"
          aria-pressed={voice.listening}
          aria-label={t("kiosk.speak")}
          onClick={voice.toggle}
        >
          <Mic aria-hidden />
        </button>
      )}
      <button
        type="submit"
        className="button primary"
        data-testid="kiosk-send"
        disabled={empty || !online}
        aria-label={t("kiosk.send")}
      >
        <SendHorizontal aria-hidden />
      </button>
      <p role="status" className={voice.missed ? "kiosk-note" : "sr-only"}>
        {voice.listening ? t("kiosk.listening") : voice.missed ? t("kiosk.notHeard") : ""}
      </p>
    </form>
  );
}
