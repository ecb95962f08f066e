"""The commands `robot-acp login`, `token` and `key`: their arguments, and one short function for each.

No token is printed but by `token create`, no code but by `login`, and no key at all. What takes long to import is
imported in the functions, so that `robot-acp --help` does not wait for it.
"""

from __future__ import annotations

import argparse
import json
import time
from datetime import UTC, datetime, tzinfo
from typing import TYPE_CHECKING, Any

from backend.identity import Role
from backend.lifetimes import lifetime

if TYPE_CHECKING:
    from backend import audit, config, tokens

MAX_NAME_CHARS = 60


def add_to(commands: Any) -> None:
    """Add `login`, `token` and `key` to the commands of a parser."""
    login = commands.add_parser("login", help="print an address that logs you in as a supervisor, once")
    login.set_defaults(run=_login)
    _add_token(commands.add_parser("token", help="login tokens: create, list, revoke"))
    _add_key(commands.add_parser("key", help="the key that signs login tokens"))


def _add_token(parser: argparse.ArgumentParser) -> None:
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    create = commands.add_parser("create", help="print a new login token; `chat` reads it from ROBOT_ACP_TOKEN")
    create.add_argument("--name", required=True, type=_name, help="who it is for")
    create.add_argument("--role", required=True, choices=[role.value for role in Role])
    create.add_argument(
        "--expires",
        type=_lifetime,
        default="7d",
        metavar="WHEN",
        help="after 30m, 12h or 7d, or at the end of a day: 2027-01-31 (default: 7d)",
    )
    create.add_argument(
        "--same-person", action="store_true", help="a further token of the person who has this name already"
    )
    create.set_defaults(run=_create)

    listing = commands.add_parser("list", help="who has a token, and whether it is valid; never the token itself")
    listing.add_argument("--json", action="store_true", help="print them as JSON")
    listing.add_argument("--logins", action="store_true", help="also the logins of browsers, and one-time codes")
    listing.set_defaults(run=_list)

    revoke = commands.add_parser("revoke", help="end a login, also where it is in use now")
    revoke.add_argument("id_or_name", metavar="ID_OR_NAME", help="one token by its id, or all of somebody's")
    revoke.set_defaults(run=_revoke)


def _add_key(parser: argparse.ArgumentParser) -> None:
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    rotate = commands.add_parser("rotate", help="make a new key, when others may know this one, or from time to time")
    rotate.add_argument(
        "--old-until",
        type=_end,
        default="7d",
        metavar="WHEN",
        help="how long tokens of the old key are accepted: 30m, 12h, 7d, a date, or `now` (default: 7d)",
    )
    rotate.set_defaults(run=_rotate)


def _name(text: str) -> str:
    name = text.strip()
    if not name or not name.isprintable() or len(name) > MAX_NAME_CHARS:
        raise argparse.ArgumentTypeError(f"a name is 1 to {MAX_NAME_CHARS} characters on one line")
    return name


def _lifetime(text: str) -> float:
    try:
        return lifetime(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _end(text: str) -> float:
    """The Unix time at which a lifetime that begins now ends."""
    return time.time() + (0.0 if text == "now" else _lifetime(text))


def _login(settings: config.Settings, _options: argparse.Namespace) -> int:
    from backend import logins  # see above

    code = logins.new_code(settings.data_dir)
    minutes = logins.CODE_LIFETIME_S / 60
    print(f"Open this address in a browser within {minutes:g} minutes. It works once:\n")
    print(f"  {settings.bridge_url}/#token={code}\n")
    return 0


def _create(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend import audit, identity, tokens  # see above

    role, same_person = Role(options.role), options.same_person
    token = tokens.create(settings.data_dir, options.name, role, options.expires, same_person=same_person)
    print(token)
    made = identity.verify([identity.shared_secret(settings.data_dir, identity.SIGNING_KEY)], token)
    audit.record_command(settings.data_dir, ("token_created", _audited(made.token_id, made.name, made.role, "created")))
    return 0


def _list(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend import tokens  # see above

    logins = options.logins
    records = [record for record in tokens.records(settings.data_dir) if logins or record.is_access]
    if options.json:
        rows = [_columns(record, "seconds", UTC, kind=logins) for record in records]
        print(json.dumps(rows, indent=2, ensure_ascii=False))
    elif not records:
        print("There are no login tokens yet. `robot-acp token create` makes one.")
    else:
        rows = [_columns(record, "minutes", kind=logins) for record in records]
        widths = {column: max(len(column), *(len(row[column]) for row in rows)) for column in rows[0]}
        for row in ({column: column.upper() for column in widths}, *rows):
            print("  ".join(row[column].ljust(width) for column, width in widths.items()).rstrip())
    return 0


def _columns(record: tokens.Record, precision: str, zone: tzinfo | None = None, *, kind: bool) -> dict[str, str]:
    """A token as `token list` shows it, with times in `zone`; None is the time zone of this computer. `kind` adds what
    it is, and the token that a login was made with."""
    created, expires = (
        datetime.fromtimestamp(when, zone).isoformat(" " if zone is None else "T", precision)
        for when in (record.created, record.expires)
    )
    extra = {"kind": record.kind, "parent": record.parent} if kind else {}
    who = {"id": record.id, "name": record.name, "role": record.role.value}
    return who | {"created": created, "expires": expires, "state": record.state} | extra


def _revoke(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend import audit, tokens  # see above

    revoked = tokens.revoke(settings.data_dir, options.id_or_name)
    events = [_audited(record.id, record.name, record.role, "revoked") for record in revoked]
    audit.record_command(settings.data_dir, *(("token_revoked", event) for event in events))
    for record in revoked:
        print(f"Revoked {record.id} of {record.name} ({record.role.value}).")
    if len(revoked) > 1:
        print(f"These were all valid tokens of {options.id_or_name}.")
    if not revoked:
        print(f"Nothing to do: no token of {options.id_or_name} is valid any more.")
    return 0


def _audited(token_id: str | None, name: str, role: Role, done: str) -> audit.Details:
    return {done: token_id, f"{done}_name": name, f"{done}_role": role.value}


def _rotate(settings: config.Settings, options: argparse.Namespace) -> int:
    from backend import audit, tokens  # see above

    count = tokens.rotate_key(settings.data_dir, options.old_until)
    audit.record_command(settings.data_dir, ("key_rotated", {"tokens": count, "old_until": options.old_until}))
    print("There is a new signing key. No process has to be started again.")
    if options.old_until > time.time():
        end = datetime.fromtimestamp(options.old_until).isoformat(" ", "minutes")
        print(f"Tokens that were valid until now: {count}. They are accepted until {end} at the longest.")
    else:
        print(f"Tokens that are revoked now: {count}. Make new ones with `robot-acp token create --same-person`.")
    return 0
