/**
 * Speed, battery and link over the last minutes, each with its numbers in words. Drawn at most twice a second, and only
 * while it is on the screen.
 */
import { useEffect, useRef, useState, type RefObject } from "react";
import { useTranslation } from "react-i18next";
import { samples } from "../../acp/screens/record-samples";
import { fixed, percent, speed } from "../../i18n/format";
import { plotPaths } from "./plot-path";
import { QUANTITIES, rangeOf, SPAN_S, type Quantity, type Series } from "../../state/samples";

const DRAW_MS = 500;
/** The drawing's own units; it is stretched to the width of its box. */
const WIDTH = 300;
const HEIGHT = 44;

/** The least value at the upper edge: noise in the last digit must not look like a change. */
const LEAST_TOP: Record<Quantity, number> = { speed: 0.5, battery: 100, link: 20 };
/** Room above the highest value. */
const HEADROOM = 1.1;

export function Plots() {
  const { t } = useTranslation();
  return (
    <section className="plots" aria-label={t("plots.title")}>
      <h3 className="plots-title muted small">{t("plots.title")}</h3>
      {QUANTITIES.map((quantity) => (
        <Plot key={quantity} quantity={quantity} />
      ))}
    </section>
  );
}

function Plot({ quantity }: { quantity: Quantity }) {
  const { t } = useTranslation();
  const figure = useRef<HTMLElement>(null);
  const { series, now } = useRecentSamples(quantity, figure);
  const range = rangeOf(series);
  const top = Math.max(LEAST_TOP[quantity], (range.most ?? 0) * HEADROOM);
  const plot = { width: WIDTH, height: HEIGHT, from: now - SPAN_S, to: now, top };
  // The link is measured every few seconds, and its value holds until it is measured again.
  const { line, area } = plotPaths(series, plot, quantity === "link");
  const value = (of: number | null): string => (of === null ? t("status.unknown") : inWords(quantity, of));
  return (
    <figure ref={figure} className="plot" data-testid={`plot-${quantity}`} data-now={range.now ?? ""}>
      <figcaption>
        <span>{t(`plots.${quantity}`)}</span>
        <strong>{value(range.now)}</strong>
        <span className="muted">
          {t("plots.range", { least: value(range.least), most: value(range.most) })}
        </span>
      </figcaption>
      {/* The line says nothing that the words above do not. */}
      <svg
        className="plot-box"
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        preserveAspectRatio="none"
        aria-hidden="true"
      >
        <path className="plot-area" d={area} />
        <path className="plot-line" d={line} />
      </svg>
    </figure>
  );
}

function inWords(quantity: Quantity, value: number): string {
  switch (quantity) {
    case "speed":
      return speed(value);
    case "battery":
      return percent(value / 100);
    case "link":
      return `${fixed(value, 0)} ms`;
  }
}

interface Recent {
  series: Series;
  /** Unix seconds of this machine's clock. */
  now: number;
}

function recentSamples(quantity: Quantity): Recent {
  const now = Date.now() / 1000;
  return { series: samples.series(quantity, now - SPAN_S), now };
}

/** The samples of the last minutes. They stay as they are while nobody can see `element`. */
function useRecentSamples(quantity: Quantity, element: RefObject<HTMLElement | null>): Recent {
  const [recent, setRecent] = useState(() => recentSamples(quantity));
  useEffect(() => {
    if (element.current === null) return;
    let visible = true;
    const refresh = (): void => {
      if (visible && document.visibilityState !== "hidden") setRecent(recentSamples(quantity));
    };
    const observer = new IntersectionObserver((entries) => {
      visible = entries.some(({ isIntersecting }) => isIntersecting);
      refresh();
    });
    observer.observe(element.current);
    const timer = setInterval(refresh, DRAW_MS);
    return () => {
      clearInterval(timer);
      observer.disconnect();
    };
  }, [quantity, element]);
  return recent;
}
