/** The list of logins: what is read of an answer, the order, and names that are taken. */
import { expect, it } from "vitest";
import { parseLogins, parseNewLogin, type IssuedLogin } from "../wire/logins";
import { loginAddress, namesake, sortLogins } from "./logins";

function login(id: string, name: string, more: Partial<IssuedLogin> = {}): IssuedLogin {
  return { id, name, role: "operator", created: 1, expires: 9, state: "valid", own: false, ...more };
}

it("reads what the bridge lists, and nothing else", () => {
  const ana = login("a", "Ana");
  expect(
    parseLogins({ tokens: [ana, { ...ana, role: "admin" }, { ...ana, state: "new" }, 5, null] }),
  ).toEqual([ana]);
  expect(parseLogins({ tokens: [] })).toEqual([]);
  for (const foreign of [null, [], {}, { tokens: "none" }, "<html>"]) expect(parseLogins(foreign)).toBeNull();
});

it("takes only an answer with a token for a new login", () => {
  const made = { token: "x.y.z", name: "Ana", role: "viewer", expires: 9 };
  expect(parseNewLogin({ ...made, id: "a" })).toEqual(made);
  for (const key of ["token", "role", "expires"])
    expect(parseNewLogin({ ...made, [key]: undefined })).toBeNull();
});

it("has one's own first, then by name, the newest of a name first, and those that have ended apart", () => {
  const logins = [
    login("1", "Vic"),
    login("2", "Ana"),
    login("3", "Ana", { created: 2 }),
    login("4", "Sue", { own: true }),
    login("5", "Eve", { state: "revoked" }),
    login("6", "Old", { state: "expired", created: 3 }),
  ];
  const { valid, ended } = sortLogins(logins);
  expect(valid.map(({ id }) => id)).toEqual(["4", "3", "2", "1"]);
  expect(ended.map(({ id }) => id)).toEqual(["6", "5"]);
});

it.each([
  ["Ana", "2"],
  [" ana  maria ", "3"],
  ["ＡＮＡ", "2"],
  ["An", undefined],
  ["", undefined],
])("knows whose name %j is", (name, id) => {
  const logins = [
    login("1", "Ana", { state: "revoked" }),
    login("2", "Ana"),
    login("3", "Ana Maria", { state: "expired" }),
  ];
  expect(namesake(logins, name)?.id).toBe(id);
});

it("hands the token over behind the #", () => {
  expect(loginAddress("http://robot:8080", "x.y.z")).toBe("http://robot:8080/#token=x.y.z");
});
