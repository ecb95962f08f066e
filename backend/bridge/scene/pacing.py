"""Keeps the map from taking the whole computer where there is no graphics chip, and from drawing where nobody sees it.

A script for viser's page that stands between it and its animation frames: quick ones that are seen pass as they come.
It must change nothing where a graphics chip draws, and never draws itself.
"""

from __future__ import annotations

PACING = """<script>
  // Without a graphics chip, drawing takes the computer from the page around the map: from Stop, from a question.
  // So after a slow frame as much time is left to others, unless a hand moves the camera. When a frame is done only a
  // fence tells: its script ends long before. So while frames are slow, none is begun before the last is done.
  // A map that is covered, as on a phone that shows the conversation, is granted frames all the same: none is drawn.
  (() => {
    const SLOW = 50, MOST = 1000, HAND = 500, COVERED = 200; // ms
    const ask = window.requestAnimationFrame.bind(window), { getContext } = HTMLCanvasElement.prototype;
    const waiting = new Map();
    let gl = null, fence = null, since = 0, cost = 0, rest = 0, hand = -Infinity;
    let last = 0, asked = false, drawing = false;

    const inSoftware = () => {
      const probe = getContext.call(document.createElement("canvas"), "webgl2");
      const told = probe?.getExtension("WEBGL_debug_renderer_info");
      const name = probe?.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : probe.RENDERER) ?? "";
      probe?.getExtension("WEBGL_lose_context")?.loseContext();
      return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
    };
    HTMLCanvasElement.prototype.getContext = function (kind, wishes) {
      if (kind !== "webgl2") return getContext.call(this, kind, wishes);
      // Smooth edges cost a processor as much as all the rest of a frame.
      gl = getContext.call(this, kind, inSoftware() ? { ...wishes, antialias: false } : wishes);
      return gl;
    };
    const covered = () => window.frameElement?.checkVisibility?.({ visibilityProperty: true }) === false;
    const forget = () => {
      gl.deleteSync(fence);
      fence = null;
    };
    const pause = (now) => { // ms until it is worth asking again; none when a frame may be drawn
      if (covered()) {
        if (fence) forget(); // when it was done, nobody will know
        return COVERED;
      }
      const free = now - hand < HAND;
      if (fence && gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.UNSIGNALED) {
        return free || Math.max(cost, now - since) < SLOW ? 0 : 10;
      }
      if (fence) {
        forget();
        cost = now - since;
        rest = now + Math.min(cost, MOST);
      }
      return free || cost < SLOW ? 0 : rest - now;
    };
    const order = () => { asked = true; ask(granted); };
    const granted = (time) => {
      const now = performance.now(), wait = pause(now);
      if (wait > 0) return setTimeout(order, wait);
      asked = false;
      drawing = true;
      for (const id of [...waiting.keys()]) { // what one callback cancels is not called
        const callback = waiting.get(id);
        waiting.delete(id);
        try { callback?.(time); } catch (error) { reportError(error); }
      }
      drawing = false;
      if (fence || !gl) return;
      since = now;
      fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      gl.flush();
    };
    window.requestAnimationFrame = (callback) => {
      waiting.set(++last, callback);
      if (!asked && !drawing) since = performance.now(); // that nothing was to be drawn is no slow frame
      if (!asked) order();
      return last;
    };
    window.cancelAnimationFrame = (id) => { waiting.delete(id); };

    const listen = (kind, then) => addEventListener(kind, then, { capture: true, passive: true });
    listen("visibilitychange", () => { since = performance.now(); }); // neither is that nobody looked
    const handed = (event) => { if (event.type !== "pointermove" || event.buttons) hand = performance.now(); };
    for (const kind of ["pointerdown", "pointermove", "wheel", "keydown"]) listen(kind, handed);
  })();
</script>
"""
