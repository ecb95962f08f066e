/** The camera's pictures, for components. The stream is open only while the picture is on the screen. */
import { useEffect, useRef, useState } from "react";
import { ReconnectingSocket } from "../scene/reconnecting-socket";
import { LatestPicture } from "../scene/latest-picture";
import { useStore } from "../state/store";

/** After so many ms without a picture the last one is removed: it must not pass for what the robot sees now. */
const OLD_MS = 3000;

export interface Camera {
  state: "connecting" | "live" | "none";
  /** The picture to show; null while there is none. */
  url: string | null;
  /** To be called when the browser has decoded the picture, or could not. */
  onDecoded: () => void;
}

export function useCamera(visible: boolean): Camera {
  const [state, setState] = useState<Camera["state"]>("connecting");
  const [url, setUrl] = useState<string | null>(null);
  const socket = useRef<ReconnectingSocket | null>(null);
  const pictures = useRef<LatestPicture | null>(null);
  const reachable = useStore((all) => all.reachable);

  useEffect(() => {
    if (!visible) return;
    const latest = new LatestPicture(setUrl);
    pictures.current = latest;
    const removeOld = (): void => {
      latest.clear();
      setState("none");
    };
    let timer = setTimeout(removeOld, OLD_MS);
    const stream = new ReconnectingSocket("/camera", {
      onMessage: (data) => {
        if (!(data instanceof Blob)) return;
        clearTimeout(timer);
        timer = setTimeout(removeOld, OLD_MS);
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
  }, [visible]);

  // A browser does not notice that a network cable was pulled out.
  useEffect(() => {
    if (!reachable) socket.current?.drop();
  }, [reachable]);

  return { state, url, onDecoded: () => pictures.current?.decoded() };
}
