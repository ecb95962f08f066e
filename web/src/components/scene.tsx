/** The live map, as soon as it answers. */
import { MapPinOff } from "lucide-react";
import { useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import { robotName, useStore } from "../state/store";

const ASK_AGAIN_MS = 5000;

/** `viewer`: the name under which this page steers its camera and picks; without one it can only be looked at. */
export function Scene({ viewer }: { viewer?: string }) {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const address = viewer === undefined ? "/scene/" : `/scene/${viewer}/`;
  const there = useSceneThere(address);
  if (there === true) return <iframe src={address} title={t("scene.frame", { robot })} />;
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

/** Whether the scene answers; asked until it does. Null while nobody knows. */
function useSceneThere(address: string): boolean | null {
  const [there, setThere] = useState<boolean | null>(null);
  const online = useStore((state) => state.reachable);
  useEffect(() => {
    if (there === true || !online) return;
    let over = false;
    const ask = async (): Promise<void> => {
      const answer = await fetch(address, { credentials: "same-origin" }).catch(() => null);
      const type = answer?.headers.get("Content-Type") ?? "";
      await answer?.body?.cancel().catch(() => undefined);
      if (!over) setThere(answer?.ok === true && type.startsWith("text/html"));
    };
    void ask();
    const timer = setInterval(() => void ask(), ASK_AGAIN_MS);
    return () => {
      over = true;
      clearInterval(timer);
    };
  }, [address, there, online]);
  return there;
}
