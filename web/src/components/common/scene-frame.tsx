/** The frame with the live map, as soon as the bridge serves it. */
import { MapPinOff } from "lucide-react";
import { useEffect, useRef, useState, type RefObject } from "react";
import { useTranslation } from "react-i18next";
import { Poll } from "../../acp/connection/poll";
import { servesScene } from "../../acp/connection/scene-probe";
import { robotName, useStore } from "../../state/store";

const ASK_AGAIN_MS = 5000;
const TELL_AGAIN_MS = 200;

/** `viewer`: the name with which this page moves the camera and picks; without one the map has no controls. */
export function SceneFrame({ viewer }: { viewer?: string }) {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const address = viewer === undefined ? "/scene/" : `/scene/${viewer}/`;
  const frame = useRef<HTMLIFrameElement>(null);
  const available = useSceneAvailable(address, frame);
  useTellFrame(frame, available === true);
  // viser's page is foreign code: without an origin of its own it can reach neither this page nor its login.
  if (available === true) {
    return <iframe ref={frame} src={address} sandbox="allow-scripts" title={t("scene.frame", { robot })} />;
  }
  return (
    <div className="scene-none">
      {available === false && (
        <>
          <MapPinOff aria-hidden />
          <p>{t("scene.unavailable")}</p>
          <p className="muted small">{t("scene.unavailableHint")}</p>
        </>
      )}
    </div>
  );
}

/**
 * Whether the bridge serves the map; asked until it does, and again after a lost connection. Null until the first answer.
 * The conversation comes first: a page that has just been opened asks once it has tried to reach the agent.
 */
function useSceneAvailable(address: string, frame: RefObject<HTMLIFrameElement | null>): boolean | null {
  const [available, setAvailable] = useState<boolean | null>(null);
  const isDue = useStore(({ reachable, link }) => {
    const opens = link.status === "off" || (link.status === "connecting" && link.first);
    return reachable && !opens;
  });
  const isWanted = available !== true && isDue;
  const probe = useRef<Poll | null>(null);
  useEffect(() => {
    const made = new Poll(async (signal) => {
      const answer = await servesScene(address, signal);
      if (signal.aborted) return;
      if (answer) made.end();
      // The same frame, so that the keyboard's focus stays in it.
      if (answer && frame.current !== null) frame.current.src = address;
      setAvailable(answer);
    }, ASK_AGAIN_MS);
    probe.current = made;
    const endWatch = onReconnected(() => made.now());
    return () => {
      endWatch();
      made.end();
    };
  }, [address, frame]);
  useEffect(() => {
    if (isWanted) probe.current?.start();
    else probe.current?.end();
  }, [address, isWanted]);
  return available;
}

/**
 * Tells the map's page, which its sandbox keeps from looking, the language of this page and whether the map is covered.
 * It is told again and again, since nothing reports either of them, nor when a reloaded map begins to listen.
 */
function useTellFrame(frame: RefObject<HTMLIFrameElement | null>, shown: boolean): void {
  useEffect(() => {
    if (!shown) return;
    const seesCover = "checkVisibility" in Element.prototype; // browsers have it since 2024
    const tell = (): void => {
      if (frame.current === null) return;
      const covered = seesCover && !frame.current.checkVisibility({ visibilityProperty: true });
      const message = { type: "scene-frame", lang: document.documentElement.lang, covered };
      frame.current.contentWindow?.postMessage(message, "*"); // its origin has no name, and this is no secret
    };
    const timer = setInterval(tell, TELL_AGAIN_MS);
    return () => clearInterval(timer);
  }, [frame, shown]);
}

/**
 * Calls back when the network was lost and is back: the map's page keeps a connection that is dead without having been
 * closed, as the one is that fell silent and was given up. One slow answer is no loss, and neither is an agent that
 * restarts. Returns a function that ends it.
 */
function onReconnected(onReconnect: () => void): () => void {
  let wasLost = false;
  let wasSilent = false;
  return useStore.subscribe(({ link, reachable, silentSince }) => {
    if (link.status !== "online") {
      wasLost ||= wasSilent || !reachable;
      return;
    }
    wasSilent = silentSince !== null;
    if (wasLost) {
      wasLost = false;
      onReconnect();
    }
  });
}
