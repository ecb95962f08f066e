/** All below the line at the top and its alerts: what takes the focus when an alert that had it goes. */

export const PANES_ID = "panes";

export const panes = (): HTMLElement | null => document.getElementById(PANES_ID);
