/** The camera's pictures, for components: the stream is open only while somebody looks. */
import { useEffect, useRef, useState } from "react";
import { ReconnectingSocket } from "../scene/reconnecting-socket";
import { LatestPicture } from "../scene/latest-picture";
import { useStore } from "../state/store";

/** ms without a picture after which the last one must not pass for what the robot sees now. */
const OLD_MS = 3000;

export interface Camera {
  state: "connecting" | "live" | "none";
  /** The picture to show; null while there is none. */
  url: string | null;
  /** To be called when the browser shows the picture, or cannot. */
  settled: () => void;
}

export function useCamera(looking: boolean): Camera {
  const [state, setState] = useState<Camera["state"]>("connecting");
  const [url, setUrl] = useState<string | null>(null);
  const socket = useRef<ReconnectingSocket | null>(null);
  const pictures = useRef<LatestPicture | null>(null);
  const reachable = useStore((all) => all.reachable);

  useEffect(() => {
    if (!looking) return;
    const latest = new LatestPicture(setUrl);
    pictures.current = latest;
    const old = (): void => {
      latest.clear();
      setState("none");
    };
    let timer = setTimeout(old, OLD_MS);
    const stream = new ReconnectingSocket("/camera", {
      onMessage: (data) => {
        if (!(data instanceof Blob)) return;
        clearTimeout(timer);
        timer = setTimeout(old, OLD_MS);
        latest.receive(data);
        setState("live");
      },
    });
    socket.current = stream;
    return () => {
      clearTimeout(timer);
      stream.end();
      latest.clear();
      socket.current = pictures.current = null;
      setState("connecting");
    };
  }, [looking]);

  // A browser does not notice a cable that was pulled out.
  useEffect(() => {
    if (!reachable) socket.current?.drop();
  }, [reachable]);

  return { state, url, settled: () => pictures.current?.decoded() };
}
