/** What supervisors do with the logins of others: list, make and revoke them. It needs the bridge alone, no agent. */
import * as http from "../../api/http";

export const { createLogin, listLogins, revokeLogin } = http;

/** Why it failed: the bridge's own sentence, which is English, or "" where nothing answers. */
export function reasonOf(error: unknown): string {
  return error instanceof http.HttpError ? error.message : "";
}
