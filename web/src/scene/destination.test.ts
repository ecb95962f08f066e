/** The words that send the robot somewhere. */
import { expect, it } from "vitest";
import { destinationOf, promptFor } from "./destination";

it("names a place where there is one", () => {
  expect(promptFor(destinationOf({ x: 1, y: 2, place: "lab 2.3.7" }))).toBe("Go to lab 2.3.7");
});

it.each([
  [12.34, 4.5, "Go to the point x 12.3, y 4.5"],
  [-3, 0, "Go to the point x -3.0, y 0.0"],
  [-0.01, 100.06, "Go to the point x 0.0, y 100.1"],
])("tells %d, %d in metres to one decimal", (x, y, words) => {
  expect(promptFor(destinationOf({ x, y, place: null }))).toBe(words);
});
