/** Who is connected and who controls the robot: a chip in the header, and the menu that it opens. */
import { Bot, Eye, Hand, Headset, ShieldUser, UserRound, Users } from "lucide-react";
import { Popover } from "radix-ui";
import { useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { sortPeople, waitingSession, type ListedPerson } from "../../state/people";
import { canTakeOver } from "../../state/rights";
import { robotName, useMe, useStore } from "../../state/store";
import { SentenceWithQuote } from "../common/sentence-with-quote";
import { useTakeOver } from "../controls/use-take-over";
import type { Role } from "../../wire/bridge";
import { visibleLine } from "../../wire/visible-text";

/** The chip. For those to whom the agent does not report who is connected, it shows only who controls the robot, without a menu. */
export function PeopleMenu() {
  const { t } = useTranslation();
  // Without telemetry the list is old: people may have left.
  const people = useStore((state) => (state.silentSince === null ? state.people : null));
  const me = useMe();
  const turn = useStore((state) => state.telemetry?.turn ?? null);
  const [open, setOpen] = useState(false);
  /** Whether the menu closes because somebody wants to take over. */
  const taking = useRef(false);
  const { ask, dialog } = useTakeOver(waitingSession(turn?.waiting, me.name));
  // Otherwise the menu would open by itself when the connection is back.
  if (people === null && open) setOpen(false);
  if (people === null) return <Holder />;
  return (
    <>
      <Popover.Root open={open} onOpenChange={setOpen}>
        <Popover.Trigger className="people" data-testid="people" data-held={turn !== null}>
          <Holder />
          <span className="people-here">
            <Users aria-hidden />
            <span className="people-count" aria-hidden="true">
              {people.length}
            </span>
            <span className="people-words">{t("people.here", { count: people.length })}</span>
          </span>
        </Popover.Trigger>
        <Popover.Portal>
          <Popover.Content
            className="menu people-menu"
            align="end"
            sideOffset={8}
            collisionPadding={8}
            aria-labelledby="people-title"
            data-testid="people-menu"
            onOpenAutoFocus={(event) => {
              // The focus is not on a button: the key that opened the menu must not take the robot over.
              event.preventDefault();
              (event.currentTarget as HTMLElement).focus();
            }}
            onCloseAutoFocus={() => {
              // Only now: the focus is on the chip again, and comes back to it after the confirmation.
              if (taking.current) ask();
              taking.current = false;
            }}
          >
            <h2 id="people-title" className="people-title">
              {t("people.here", { count: people.length })}
            </h2>
            <Control
              onTakeOver={() => {
                taking.current = true;
                setOpen(false);
              }}
            />
            <ul className="people-list">
              {sortPeople(people, turn, me).map((person) => (
                <Row key={`${person.role} ${person.name}`} person={person} />
              ))}
            </ul>
          </Popover.Content>
        </Popover.Portal>
      </Popover.Root>
      {dialog}
    </>
  );
}

function Holder() {
  const { t } = useTranslation();
  const me = useMe();
  const holder = useStore((state) => state.telemetry?.turn?.by ?? null);
  if (holder === null) return null;
  return (
    <span className="metric people-holder" data-testid="status-holder">
      <Hand aria-hidden />
      <span className="metric-value holder-words">
        {holder === me.name ? t("status.heldByYou") : t("status.heldBy", { name: holder })}
      </span>
      <span className="metric-value holder-short" aria-hidden="true">
        {visibleLine(holder)}
      </span>
    </span>
  );
}

/** Who controls the robot, and for supervisors the button to take over. */
function Control({ onTakeOver }: { onTakeOver: () => void }) {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  const turn = useStore((state) => state.telemetry?.turn ?? null);
  const holder = turn?.by ?? null;
  return (
    <div className="people-control" data-held={holder !== null}>
      <Hand aria-hidden />
      <p>
        {holder === null
          ? t("people.free", { robot })
          : holder === me.name
            ? t("people.youHave", { robot })
            : t("people.has", { robot, name: holder })}
      </p>
      {holder !== null && holder !== me.name && canTakeOver(me.role) && (
        <button type="button" className="button" data-testid="take-over" onClick={onTakeOver}>
          {t("people.takeOver")}
        </button>
      )}
    </div>
  );
}

const ICONS: Record<Role, typeof Bot> = {
  supervisor: ShieldUser,
  operator: Headset,
  visitor: UserRound,
  viewer: Eye,
};

function Row({ person }: { person: ListedPerson }) {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const Icon = ICONS[person.role];
  const facts = [
    t(`role.${person.role}`),
    person.connections > 1 ? t("people.devices", { count: person.connections }) : null,
  ].filter((fact) => fact !== null);
  return (
    <li className="person" data-testid="person" data-name={person.name}>
      <Icon aria-hidden className="person-icon" />
      <div className="person-text">
        <p className="person-name">
          <span className="person-own-name" title={visibleLine(person.name)}>
            {visibleLine(person.name)}
          </span>
          {person.you && <span className="muted">({t("people.you")})</span>}
          {person.holding !== null && (
            <span className="person-holding" data-holding={person.holding}>
              {t(person.holding === "has" ? "people.markHas" : "people.markWaits", { robot })}
            </span>
          )}
        </p>
        <p className="person-facts">{facts.join(" · ")}</p>
        <Watching sessions={person.sessions} />
      </div>
    </li>
  );
}

/** The session that the person opened last, by its title where this page knows it. */
function Watching({ sessions }: { sessions: string[] }) {
  const { t } = useTranslation();
  const first = sessions[0];
  const title = useStore((state) => {
    if (first === undefined) return null;
    const listed = [...state.sessions, ...(state.found?.sessions ?? [])];
    const known = listed.find(({ sessionId }) => sessionId === first);
    return known?.title ?? state.conversations[first]?.title ?? null;
  });
  if (first === undefined) return null;
  const count = sessions.length - 1;
  return (
    <p className="person-facts person-watching" title={title === null ? undefined : visibleLine(title)}>
      {title === null ? (
        t("people.watches", { count: sessions.length })
      ) : (
        <SentenceWithQuote
          sentence={
            count === 0 ? t("people.watchesOne", { title }) : t("people.watchesMore", { title, count })
          }
          quote={title}
        />
      )}
    </p>
  );
}
