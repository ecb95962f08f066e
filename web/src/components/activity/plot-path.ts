/** The lines of the small plots, as SVG path data. Pure. */
import type { Series } from "../../state/samples";

export interface PlotArea {
  width: number;
  height: number;
  /** The Unix seconds at the left edge and at the right one. */
  from: number;
  to: number;
  /** The value at the upper edge; the lower edge is 0. */
  top: number;
}

export interface PlotPaths {
  line: string;
  /** The area between the line and 0. */
  area: string;
}

/**
 * Where a value is missing, the line has a gap. `stepped`: a value holds until the next one, as for a quantity that is
 * measured every few seconds.
 */
export function plotPaths(series: Series, plot: PlotArea, stepped = false): PlotPaths {
  const runs = runsOf(series).map((run) => pointsOf(run, plot, stepped));
  return {
    line: runs.map((points) => `M${points.join("L")}`).join(""),
    area: runs.map((points) => areaBelow(points, plot.height)).join(""),
  };
}

type Sample = [at: number, value: number];

/** The samples without the gaps: each run is one unbroken line. */
function runsOf({ at, values }: Series): Sample[][] {
  const runs: Sample[][] = [];
  let previous: number | null = null;
  values.forEach((value, index) => {
    const time = at[index];
    if (value !== null && time !== undefined) {
      if (previous === null) runs.push([]);
      runs.at(-1)?.push([time, value]);
    }
    previous = value;
  });
  return runs;
}

function pointsOf(run: Sample[], { width, height, from, to, top }: PlotArea, stepped: boolean): string[] {
  const x = (at: number): string => (((at - from) / (to - from)) * width).toFixed(1);
  const y = (value: number): string => (height - (value / top) * height).toFixed(1);
  return run.flatMap(([at, value], index) => {
    const before = run[index - 1];
    const point = `${x(at)} ${y(value)}`;
    return stepped && before !== undefined ? [`${x(at)} ${y(before[1])}`, point] : [point];
  });
}

function areaBelow(points: string[], height: number): string {
  const [first = "", last = ""] = [points[0], points.at(-1)].map((point) => point?.split(" ")[0]);
  return `M${first} ${height}L${points.join("L")}L${last} ${height}Z`;
}
