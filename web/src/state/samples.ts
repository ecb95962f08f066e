/** The robot's speed, battery and link over the last five minutes, for the plots: a ring of fixed size. */

export const SPAN_S = 300;
export const EVERY_MS = 500;
const CAPACITY = (SPAN_S * 1000) / EVERY_MS;

export const QUANTITIES = ["speed", "battery", "link"] as const;
export type Quantity = (typeof QUANTITIES)[number];

/** Null is a gap: nobody knew. */
export type Values = Record<Quantity, number | null>;

export interface Series {
  /** Unix seconds of this machine's clock. */
  at: number[];
  values: (number | null)[];
}

/** A ring: the newest sample takes the place of the oldest. */
export class Samples {
  private readonly at: Float64Array;
  private readonly values: Record<Quantity, Float64Array>;
  private made = 0;

  constructor(private readonly capacity: number = CAPACITY) {
    const empty = (): Float64Array => new Float64Array(capacity);
    this.at = empty();
    this.values = { speed: empty(), battery: empty(), link: empty() };
  }

  add(at: number, values: Values): void {
    const place = this.made++ % this.capacity;
    this.at[place] = at;
    for (const quantity of QUANTITIES) this.values[quantity][place] = values[quantity] ?? NaN;
  }

  /** What is not older than `since`, oldest first. */
  series(quantity: Quantity, since: number): Series {
    const series: Series = { at: [], values: [] };
    for (let index = Math.max(0, this.made - this.capacity); index < this.made; index++) {
      const place = index % this.capacity;
      const at = this.at[place] ?? 0;
      if (at < since) continue;
      const value = this.values[quantity][place] ?? NaN;
      series.at.push(at);
      series.values.push(Number.isNaN(value) ? null : value);
    }
    return series;
  }
}

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
