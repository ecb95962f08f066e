/**
 * Speed, battery and link over the last minutes, each with its numbers in words. Drawn at most twice a second, and only
 * while it is on the screen.
 */
import { useEffect, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { samples } from "../../acp/screens/record-samples";
import { fixed, percent, speed } from "../../i18n/format";
import { QUANTITIES, rangeOf, SPAN_S, type Quantity, type Range } from "../../state/samples";

const DRAW_MS = 500;
const HEIGHT = 44;

/** From 0 up, at least this far: unrest in the last digit must not look like a change. */
const REACH: Record<Quantity, number> = { speed: 0.5, battery: 100, link: 20 };

export default function Plots() {
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

const NOTHING: Range = { now: null, least: null, most: null };

function Plot({ quantity }: { quantity: Quantity }) {
  const { t } = useTranslation();
  const box = useRef<HTMLDivElement>(null);
  const [range, setRange] = useState<Range>(NOTHING);
  useEffect(() => (box.current === null ? undefined : draw(box.current, quantity, setRange)), [quantity]);
  const value = (of: number | null): string => (of === null ? t("status.unknown") : inWords(quantity, of));
  return (
    <figure className="plot" data-testid={`plot-${quantity}`} data-now={range.now ?? ""}>
      <figcaption>
        <span>{t(`plots.${quantity}`)}</span>
        <strong>{value(range.now)}</strong>
        <span className="muted">
          {t("plots.range", { least: value(range.least), most: value(range.most) })}
        </span>
      </figcaption>
      {/* The line says nothing that the words above do not. */}
      <div className="plot-box" ref={box} aria-hidden="true" />
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

/** Draws into `box` until what it returns is called. */
function draw(box: HTMLElement, quantity: Quantity, tell: (range: Range) => void): () => void {
  let plot = plotted(box, quantity);
  let seen = true;
  const refresh = (): void => {
    if (!seen || document.visibilityState === "hidden") return;
    const now = Date.now() / 1000;
    const series = samples.series(quantity, now - SPAN_S);
    plot.setData([series.at, series.values], false);
    plot.setScale("x", { min: now - SPAN_S, max: now });
    const range = rangeOf(series);
    plot.setScale("y", { min: 0, max: Math.max(REACH[quantity], (range.most ?? 0) * 1.1) });
    tell(range);
  };
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const repaint = (): void => {
    plot.destroy();
    plot = plotted(box, quantity);
    refresh();
  };
  const resized = new ResizeObserver(() => {
    if (box.clientWidth > 0) plot.setSize({ width: box.clientWidth, height: HEIGHT });
  });
  const looked = new IntersectionObserver((entries) => {
    seen = entries.some(({ isIntersecting }) => isIntersecting);
    refresh();
  });
  const timer = setInterval(refresh, DRAW_MS);
  dark.addEventListener("change", repaint);
  resized.observe(box);
  looked.observe(box);
  refresh();
  return () => {
    clearInterval(timer);
    dark.removeEventListener("change", repaint);
    resized.disconnect();
    looked.disconnect();
    plot.destroy();
  };
}

function plotted(box: HTMLElement, quantity: Quantity): uPlot {
  const token = (name: string): string => getComputedStyle(box).getPropertyValue(name).trim();
  return new uPlot(
    {
      width: Math.max(box.clientWidth, 40),
      height: HEIGHT,
      padding: [4, 0, 2, 0],
      cursor: { show: false },
      legend: { show: false },
      axes: [{ show: false }, { show: false }],
      scales: { x: { time: false, auto: false }, y: { auto: false } },
      series: [
        {},
        {
          stroke: token("--accent"),
          fill: token("--accent-soft"),
          width: 1.5,
          spanGaps: false,
          points: { show: false },
          // The link is measured every few seconds and holds until it is measured again.
          ...(quantity === "link" && uPlot.paths.stepped ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}),
        },
      ],
    },
    [[], []],
    box,
  );
}
