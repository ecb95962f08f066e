/** What a model writes shows where it leads and what is in it. */
import { render, screen } from "@testing-library/react";
import { expect, it } from "vitest";
import Markdown from "./markdown";

it.each([
  ["[the bank](https://evil.example/x)", "the bank (evil.example)"],
  ["[https://bank.example](https://bank.example@evil.example/)", "https://bank.example (evil.example)"],
  ["<https://lab.example/page>", "https://lab.example/page (lab.example)"],
  ["[write](mailto:ana@lab.example)", "write (ana@lab.example)"],
])("shows the host of a link: %s", (text, shown) => {
  render(<Markdown text={text} />);
  expect(screen.getByRole("link").textContent).toBe(shown);
});

it("shows what nobody would see", () => {
  render(<Markdown text={"I \u202Enrut\u202C left.\n\nDone."} />);
  expect(document.body.textContent).toContain("I ‹U+202E›nrut‹U+202C› left.");
  expect(screen.getByText("Done.").tagName).toBe("P");
});
