/** Pictures that the robot took and sounds that it made. Nothing plays by itself. */
import { Pause, Play, X } from "lucide-react";
import { Dialog } from "radix-ui";
import { useEffect, useRef, useState } from "react";
import { useTranslation } from "react-i18next";

/** Only what a browser shows or plays without executing anything. */
export function safeType(mimeType: string, kind: "image" | "audio"): string {
  return new RegExp(`^${kind}/(?!svg)[\\w.+-]+$`).test(mimeType) ? mimeType : `${kind}/*`;
}

export function Picture({ data, mimeType, title }: { data: string; mimeType: string; title: string }) {
  const { t } = useTranslation();
  const source = `data:${safeType(mimeType, "image")};base64,${data}`;
  const words = t("talk.picture", { title });
  return (
    <Dialog.Root>
      <Dialog.Trigger className="picture" aria-label={`${words}. ${t("talk.enlarge")}`}>
        <img src={source} alt={words} />
      </Dialog.Trigger>
      <Dialog.Portal>
        <Dialog.Overlay className="overlay" />
        <Dialog.Content className="lightbox" aria-describedby={undefined}>
          <Dialog.Title className="sr-only">{words}</Dialog.Title>
          <img src={source} alt={words} />
          <Dialog.Close className="icon-button lightbox-close" aria-label={t("talk.close")}>
            <X aria-hidden />
          </Dialog.Close>
        </Dialog.Content>
      </Dialog.Portal>
    </Dialog.Root>
  );
}

function time(seconds: number): string {
  const whole = Number.isFinite(seconds) ? Math.round(seconds) : 0;
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

export function Sound({ data, mimeType }: { data: string; mimeType: string }) {
  const { t } = useTranslation();
  const player = useRef<HTMLAudioElement>(null);
  const [playing, setPlaying] = useState(false);
  const [at, setAt] = useState(0);
  const [all, setAll] = useState(0);

  useEffect(() => {
    const audio = player.current;
    return () => audio?.pause();
  }, []);

  const toggle = (): void => {
    const audio = player.current;
    if (audio === null) return;
    if (audio.paused) void audio.play().catch(() => setPlaying(false));
    else audio.pause();
  };
  return (
    <div className="sound">
      {/* What is spoken stands above in words: it is the tool call's title. */}
      {/* eslint-disable-next-line jsx-a11y/media-has-caption */}
      <audio
        ref={player}
        src={`data:${safeType(mimeType, "audio")};base64,${data}`}
        preload="metadata"
        onPlay={() => setPlaying(true)}
        onPause={() => setPlaying(false)}
        onTimeUpdate={(event) => setAt(event.currentTarget.currentTime)}
        onLoadedMetadata={(event) => setAll(event.currentTarget.duration)}
      />
      <button
        type="button"
        className="icon-button sound-button"
        aria-label={t(playing ? "sound.pause" : "sound.play")}
        onClick={toggle}
      >
        {playing ? <Pause aria-hidden /> : <Play aria-hidden />}
      </button>
      <span className="track" aria-hidden="true">
        <span className="track-done" style={{ width: `${all > 0 ? Math.min(100, (at / all) * 100) : 0}%` }} />
      </span>
      <span className="sound-time">{t("sound.position", { at: time(at), all: time(all) })}</span>
    </div>
  );
}
