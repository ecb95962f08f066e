/** The newest picture wins, and no URL is left behind. */
import { beforeEach, expect, it, vi } from "vitest";
import { LatestPicture } from "./latest-picture";

const names = new Map<Blob, string>();
const live = new Set<string>();
let shown: (string | null)[];
let pictures: LatestPicture;

function picture(name: string): Blob {
  const blob = new Blob([name]);
  names.set(blob, name);
  return blob;
}

beforeEach(() => {
  live.clear();
  shown = [];
  pictures = new LatestPicture((url) => shown.push(url));
  URL.createObjectURL = vi.fn((blob: Blob) => {
    const url = names.get(blob) ?? "";
    live.add(url);
    return url;
  });
  URL.revokeObjectURL = vi.fn((url: string) => void live.delete(url));
});

it("shows one after the other and gives the former back", () => {
  for (const name of ["a", "b", "c"]) {
    pictures.receive(picture(name));
    pictures.decoded();
  }
  expect(shown).toEqual(["a", "b", "c"]);
  expect([...live]).toEqual(["c"]);
});

it("keeps the former until the next is drawn", () => {
  pictures.receive(picture("a"));
  pictures.decoded();
  pictures.receive(picture("b"));
  expect([...live]).toEqual(["a", "b"]);
});

it("leaves out what has become old while the browser was busy", () => {
  for (const name of ["a", "b", "c", "d"]) pictures.receive(picture(name));
  expect(shown).toEqual(["a"]);
  pictures.decoded();
  expect(shown).toEqual(["a", "d"]);
});

it("leaves nothing behind at the end", () => {
  pictures.receive(picture("a"));
  pictures.decoded();
  pictures.receive(picture("b"));
  pictures.receive(picture("c"));
  pictures.clear();
  pictures.decoded();
  expect([...live]).toEqual([]);
  expect(shown).toEqual(["a", "b", null]);
});
