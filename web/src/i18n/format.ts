/** Numbers and times as text, in the language of the page. */
import i18next from "./index";

/** The region is the reader's own: "en" alone would give everybody American times. */
function locale(): string {
  const own = navigator.languages.find((tag) => tag.split("-")[0] === i18next.language);
  return own ?? i18next.language;
}

function number(value: number, digits: number): string {
  // Adding 0 turns -0 into 0: no screen shows "-0.0 m/s".
  const rounded = Number(value.toFixed(digits)) + 0;
  return new Intl.NumberFormat(locale(), {
    minimumFractionDigits: digits,
    maximumFractionDigits: digits,
  }).format(rounded);
}

export const fixed = number;

export function percent(fraction: number): string {
  return new Intl.NumberFormat(locale(), { style: "percent" }).format(fraction);
}

export function speed(metresPerSecond: number): string {
  return i18next.t("status.metresPerSecond", { value: number(Math.abs(metresPerSecond), 1) });
}

export function seconds(value: number): string {
  return i18next.t("summary.seconds", { value: number(value, value < 10 ? 1 : 0) });
}

/** A time that is an estimate, in whole seconds. */
export function wholeSeconds(value: number): string {
  return i18next.t("summary.seconds", { value: number(Math.ceil(value), 0) });
}

export function metres(value: number): string {
  return i18next.t("summary.metres", { value: number(value, 1) });
}

/** From -pi..pi to 0..359, counter-clockwise from the map's x axis. */
export function degrees(yaw: number): string {
  return number(((Math.round((yaw * 180) / Math.PI) % 360) + 360) % 360, 0);
}

/** The time of day, with the date before it unless that is today: yesterday's stop must not look like today's. */
export function clock(unixSeconds: number): string {
  const date = new Date(unixSeconds * 1000);
  const now = new Date();
  const day: Intl.DateTimeFormatOptions =
    date.toDateString() === now.toDateString()
      ? {}
      : {
          day: "numeric",
          month: "short",
          ...(date.getFullYear() === now.getFullYear() ? {} : { year: "numeric" }),
        };
  const time: Intl.DateTimeFormatOptions = { hour: "numeric", minute: "2-digit", second: "2-digit" };
  return new Intl.DateTimeFormat(locale(), { ...day, ...time }).format(date);
}

/** A day and a time of that day, to the minute. */
export function dayAndTime(unixSeconds: number): string {
  const style: Intl.DateTimeFormatOptions = { dateStyle: "medium", timeStyle: "short" };
  return new Intl.DateTimeFormat(locale(), style).format(new Date(unixSeconds * 1000));
}

/** The time of day for a date of today, else the day. */
export function when(date: Date, now: Date): string {
  const style: Intl.DateTimeFormatOptions =
    date.toDateString() === now.toDateString()
      ? { hour: "2-digit", minute: "2-digit" }
      : { day: "numeric", month: "short" };
  return new Intl.DateTimeFormat(locale(), style).format(date);
}
