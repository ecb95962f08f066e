/** The robot's speed and battery and the link's latency over the last five minutes, for the plots. */

/** The time that the plots show. */
export const SPAN_S = 300;
/** Between two samples. */
export const SAMPLE_MS = 500;
const CAPACITY = (SPAN_S * 1000) / SAMPLE_MS;

export const QUANTITIES = ["speed", "battery", "link"] as const;
export type Quantity = (typeof QUANTITIES)[number];

/** m/s, percent and ms; null where the value is not known. */
export type Values = Record<Quantity, number | null>;

export interface Series {
  /** Unix seconds of this machine's clock. */
  at: number[];
  values: (number | null)[];
}

/** A ring buffer: the newest sample takes the place of the oldest. */
export class Samples {
  private readonly at: Float64Array;
  private readonly values: Record<Quantity, Float64Array>;
  /** How many samples were ever added. */
  private count = 0;

  constructor(private readonly capacity: number = CAPACITY) {
    const empty = (): Float64Array => new Float64Array(capacity);
    this.at = empty();
    this.values = { speed: empty(), battery: empty(), link: empty() };
  }

  add(at: number, values: Values): void {
    const slot = this.count++ % this.capacity;
    this.at[slot] = at;
    for (const quantity of QUANTITIES) this.values[quantity][slot] = values[quantity] ?? NaN;
  }

  /** The samples that are not older than `since`, in Unix seconds, oldest first. */
  series(quantity: Quantity, since: number): Series {
    const series: Series = { at: [], values: [] };
    for (let index = Math.max(0, this.count - this.capacity); index < this.count; index++) {
      const slot = index % this.capacity;
      const at = this.at[slot] ?? 0;
      if (at < since) continue;
      const value = this.values[quantity][slot] ?? NaN;
      series.at.push(at);
      series.values.push(Number.isNaN(value) ? null : value);
    }
    return series;
  }
}

/** The latest, the lowest and the highest value; null where none is known. */
export interface Range {
  now: number | null;
  least: number | null;
  most: number | null;
}

export function rangeOf({ values }: Series): Range {
  const known = values.filter((value) => value !== null);
  const now = values.at(-1) ?? null;
  if (known.length === 0) return { now, least: null, most: null };
  return { now, least: Math.min(...known), most: Math.max(...known) };
}
