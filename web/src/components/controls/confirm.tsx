/**
 * Asks for confirmation of an action that matters. The safe answer has the focus. Afterwards the focus goes back to where
 * it was; where Yes removes that element, `after` names another one.
 */
import { AlertDialog } from "radix-ui";
import { useRef, type ReactNode } from "react";
import { panes } from "./panes";

export function Confirm(props: {
  open: boolean;
  onOpenChange: (open: boolean) => void;
  title: string;
  text: ReactNode;
  no: string;
  yes: string;
  onYes: () => void;
  danger?: boolean;
  /** The element that has the focus after Yes; by default the one that had it before. */
  after?: () => HTMLElement | null;
  testId?: string;
}) {
  const opener = useRef<Element | null>(null);
  const next = useRef<HTMLElement | null>(null);
  return (
    <AlertDialog.Root open={props.open} onOpenChange={props.onOpenChange}>
      <AlertDialog.Portal>
        <AlertDialog.Overlay className="overlay" />
        <AlertDialog.Content
          className="dialog"
          onOpenAutoFocus={() => {
            opener.current = document.activeElement;
            next.current = null;
          }}
          onCloseAutoFocus={(event) => {
            // Radix gives the focus back only to a trigger of the dialog's own.
            event.preventDefault();
            const before = opener.current instanceof HTMLElement ? opener.current : null;
            const target = next.current ?? before;
            // An update may have removed it meanwhile.
            (target?.isConnected === true ? target : panes())?.focus();
          }}
        >
          <AlertDialog.Title>{props.title}</AlertDialog.Title>
          <AlertDialog.Description>{props.text}</AlertDialog.Description>
          <div className="dialog-actions">
            <AlertDialog.Cancel className="button">{props.no}</AlertDialog.Cancel>
            <AlertDialog.Action
              className={props.danger === true ? "button danger" : "button primary"}
              data-testid={props.testId}
              onClick={() => {
                next.current = props.after?.() ?? null;
                props.onYes();
              }}
            >
              {props.yes}
            </AlertDialog.Action>
          </div>
        </AlertDialog.Content>
      </AlertDialog.Portal>
    </AlertDialog.Root>
  );
}
