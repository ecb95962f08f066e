/** The live map, as soon as it answers. */
import { MapPinOff } from "lucide-react";
import { useEffect, useRef, useState, type RefObject } from "react";
import { useTranslation } from "react-i18next";
import { robotName, useStore } from "../../state/store";

const ASK_AGAIN_MS = 5000;

/** `viewer`: the name under which this page steers its camera and picks; without one it can only be looked at. */
export function Scene({ viewer }: { viewer?: string }) {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const address = viewer === undefined ? "/scene/" : `/scene/${viewer}/`;
  const frame = useRef<HTMLIFrameElement>(null);
  const there = useSceneThere(address, frame);
  if (there === true) return <iframe ref={frame} src={address} title={t("scene.frame", { robot })} />;
  return (
    <div className="scene-none">
      {there === false && (
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
 * Whether the scene answers; asked until it does, and once more after a cut. Null while nobody knows. The conversation
 * comes first: a page that has just been opened draws its map once it has tried to reach the agent.
 */
function useSceneThere(address: string, frame: RefObject<HTMLIFrameElement | null>): boolean | null {
  const [there, setThere] = useState<boolean | null>(null);
  const isDue = useStore(({ reachable, link }) => {
    const opens = link.status === "off" || (link.status === "connecting" && link.first);
    return reachable && !opens;
  });
  useEffect(() => {
    if (there === true || !isDue) return;
    let over = false;
    const ask = async (): Promise<void> => {
      const answer = await answers(address);
      if (!over) setThere(answer);
    };
    void ask();
    const timer = setInterval(() => void ask(), ASK_AGAIN_MS);
    return () => {
      over = true;
      clearInterval(timer);
    };
  }, [address, there, isDue]);
  useEffect(
    () =>
      onReturn(() => {
        void answers(address).then((answer) => {
          // The same frame, so that whoever was in it with the keyboard stays there.
          if (answer && frame.current !== null) frame.current.src = address;
          setThere(answer);
        });
      }),
    [address, frame],
  );
  return there;
}

async function answers(address: string): Promise<boolean> {
  const answer = await fetch(address, { credentials: "same-origin" }).catch(() => null);
  const type = answer?.headers.get("Content-Type") ?? "";
  await answer?.body?.cancel().catch(() => undefined);
  return answer?.ok === true && type.startsWith("text/html");
}

/**
 * Calls when the network was away and is back: the map's page trusts a connection that is dead without having been
 * closed, as the one is that fell silent and was given up. One slow answer is no cut, and neither is an agent that
 * starts anew. Returns what ends it.
 */
function onReturn(back: () => void): () => void {
  let away = false;
  let silent = false;
  return useStore.subscribe(({ link, reachable, silentSince }) => {
    if (link.status !== "online") {
      away ||= silent || !reachable;
      return;
    }
    silent = silentSince !== null;
    if (away) {
      away = false;
      back();
    }
  });
}
