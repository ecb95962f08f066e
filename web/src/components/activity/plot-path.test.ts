/** The lines of the plots: in scale, with gaps where nothing is known. */
import { expect, it } from "vitest";
import { plotPaths } from "./plot-path";

const AREA = { width: 100, height: 40, from: 0, to: 10, top: 2 };

it("puts the oldest time at the left edge and 0 at the lower one", () => {
  const { line, area } = plotPaths({ at: [0, 5, 10], values: [0, 1, 2] }, AREA);
  expect(line).toBe("M0.0 40.0L50.0 20.0L100.0 0.0");
  expect(area).toBe("M0.0 40L0.0 40.0L50.0 20.0L100.0 0.0L100.0 40Z");
});

it("interrupts the line where a value is missing", () => {
  const { line } = plotPaths({ at: [0, 1, 2, 3], values: [1, null, 1, 1] }, AREA);
  expect(line).toBe("M0.0 20.0M20.0 20.0L30.0 20.0");
});

it("holds a value until the next one where the quantity is measured rarely", () => {
  const { line } = plotPaths({ at: [0, 5], values: [0, 2] }, AREA, true);
  expect(line).toBe("M0.0 40.0L50.0 40.0L50.0 0.0");
});

it("draws nothing of nothing", () => {
  expect(plotPaths({ at: [], values: [] }, AREA)).toEqual({ line: "", area: "" });
});
