/** The player of a sound that the robot made. Nothing plays by itself. */
import { Pause, Play } from "lucide-react";
import { useEffect, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { safeType } from "./media-type";

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
