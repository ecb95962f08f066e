/** Everything below the header and the alerts: it takes the focus when an alert that had it disappears. */

export const PANES_ID = "panes";

export const panes = (): HTMLElement | null => document.getElementById(PANES_ID);
