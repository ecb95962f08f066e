/** A login link counts from the moment at which the page is there, drawn or not. */
import { beforeEach, expect, it, vi } from "vitest";

vi.mock("./app", () => ({ App: () => null }));

const logins = vi.fn();

beforeEach(() => {
  document.body.innerHTML = "<div id=root></div>";
  vi.stubGlobal("fetch", (path: string, { body }: RequestInit) => {
    logins(path, body);
    return new Promise(() => undefined);
  });
});

it("is taken from the address before anything is drawn, and when it comes later", async () => {
  window.history.replaceState(null, "", "/#token=first");
  await import("./main");
  expect(window.location.hash).toBe("");
  expect(logins).toHaveBeenCalledExactlyOnceWith("/api/login", JSON.stringify({ token: "first" }));
  window.history.replaceState(null, "", "/#token=second");
  window.dispatchEvent(new Event("hashchange"));
  expect(logins).toHaveBeenLastCalledWith("/api/login", JSON.stringify({ token: "second" }));
});
