/** Supervisors see who can log in, make logins that are shown once, and end them after they have confirmed it. */
import { fireEvent, render, screen, waitFor, within } from "@testing-library/react";
import { beforeEach, expect, it, vi } from "vitest";
import { INITIAL, setState } from "../../state/store";
import LoginsDialog from "./logins-dialog";

const SUE = { id: "s", name: "Sue", role: "supervisor", created: 1, expires: 4e9, state: "valid", own: true };
const ANA = { id: "a", name: "Ana", role: "operator", created: 1, expires: 4e9, state: "valid", own: false };
const OLD = { id: "o", name: "Old", role: "viewer", created: 1, expires: 2, state: "expired", own: false };

/** What the page asked for: method, path and body. */
let asked: [string, string, unknown][] = [];
let answer: (method: string) => Response;

beforeEach(() => {
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe = vi.fn();
      unobserve = vi.fn();
      disconnect = vi.fn();
    },
  );
  asked = [];
  answer = () => Response.json({ tokens: [SUE, ANA, OLD] });
  vi.stubGlobal("fetch", (path: string, options: { method: string; body?: string }) => {
    asked.push([options.method, path, options.body === undefined ? null : JSON.parse(options.body)]);
    return Promise.resolve(answer(options.method));
  });
  setState({ ...INITIAL, auth: { status: "in", me: { name: "Sue", role: "supervisor", robot: "Sancho" } } });
});

function rowOf(name: string): HTMLElement {
  const row = screen.getAllByTestId("login-row").find(({ dataset }) => dataset["name"] === name);
  if (row === undefined) throw new Error(`no login of ${name}`);
  return row;
}

it("lists who can log in, with role and state, one's own first", async () => {
  render(<LoginsDialog onClose={vi.fn()} />);
  await screen.findAllByTestId("login-row");
  expect(screen.getAllByTestId("login-row").map((row) => row.dataset["name"])).toEqual(["Sue", "Ana", "Old"]);
  expect(rowOf("Sue").textContent).toContain("you, on this page");
  expect(rowOf("Ana").textContent).toContain("operator · until");
  expect(rowOf("Old").textContent).toContain("expired");
  expect(within(rowOf("Old")).queryByRole("button")).toBeNull();
});

it("ends a login after a confirmation, and one's own only when that is said", async () => {
  render(<LoginsDialog onClose={vi.fn()} />);
  fireEvent.click(await screen.findByRole("button", { name: "Revoke a login of Ana" }));
  expect(screen.getByRole("alertdialog").textContent).toContain("Ana is logged out at once");
  expect(asked.filter(([method]) => method === "DELETE")).toEqual([]);
  fireEvent.click(screen.getByTestId("login-revoke-confirm"));
  await waitFor(() => expect(asked).toContainEqual(["DELETE", "/api/tokens/a", null]));
  fireEvent.click(await screen.findByRole("button", { name: "Revoke a login of Sue" }));
  expect(screen.getByRole("alertdialog").textContent).toContain("the login that you use now");
  fireEvent.click(screen.getByTestId("login-revoke-confirm"));
  await waitFor(() => expect(asked).toContainEqual(["DELETE", "/api/tokens/s?own=true", null]));
});

it("shows a new login once, and nothing of it after that", async () => {
  const close = vi.fn();
  render(<LoginsDialog onClose={close} />);
  fireEvent.click(await screen.findByTestId("login-new"));
  expect(screen.getByTestId("login-create")).toHaveProperty("disabled", true);
  fireEvent.change(screen.getByTestId("login-name"), { target: { value: " Kiosk " } });
  fireEvent.click(screen.getByRole("radio", { name: /visitor/ }));
  fireEvent.change(screen.getByTestId("login-lifetime"), { target: { value: "30d" } });
  answer = (method) =>
    method === "POST"
      ? Response.json({ token: "x.y.z", name: "Kiosk", role: "visitor", expires: 4e9 }, { status: 201 })
      : Response.json({ tokens: [SUE] });
  fireEvent.click(screen.getByTestId("login-create"));
  const address = await screen.findByTestId<HTMLInputElement>("login-address");
  expect(address.value).toBe(`${window.location.origin}/#token=x.y.z`);
  expect(asked).toContainEqual([
    "POST",
    "/api/tokens",
    { name: "Kiosk", role: "visitor", expires: "30d", same_person: false },
  ]);
  fireEvent.keyDown(address, { key: "Escape" });
  expect(close).not.toHaveBeenCalled();
  fireEvent.click(screen.getByTestId("login-done"));
  expect(screen.queryByDisplayValue(/x\.y\.z/)).toBeNull();
});

it("makes a further login of somebody only when that is said to be meant, in the same role", async () => {
  render(<LoginsDialog onClose={vi.fn()} />);
  await screen.findAllByTestId("login-row");
  fireEvent.click(screen.getByTestId("login-new"));
  fireEvent.change(screen.getByTestId("login-name"), { target: { value: "ana" } });
  expect(screen.getByText("There is Ana already (operator).")).toBeDefined();
  expect(screen.getByTestId("login-create")).toHaveProperty("disabled", true);
  fireEvent.click(screen.getByTestId("login-same-person"));
  answer = () => Response.json({ error: "Something else." }, { status: 409 });
  fireEvent.click(screen.getByTestId("login-create"));
  expect((await screen.findByRole("alert")).textContent).toBe("Something else.");
  expect(asked).toContainEqual([
    "POST",
    "/api/tokens",
    { name: "Ana", role: "operator", expires: "7d", same_person: true },
  ]);
  expect(screen.getByTestId("login-create")).toHaveProperty("disabled", false);
});

it("says that the list cannot be had, and tries again", async () => {
  answer = () => new Response("<html>", { status: 200 });
  render(<LoginsDialog onClose={vi.fn()} />);
  expect((await screen.findByRole("alert")).textContent).toContain("does not answer");
  answer = () => Response.json({ tokens: [ANA] });
  fireEvent.click(screen.getByRole("button", { name: "Try again" }));
  await screen.findAllByTestId("login-row");
  expect(screen.queryByRole("alert")).toBeNull();
});
