/**
 * Asks once before something that matters. The safe answer has the focus, which goes back to where it was; after Yes to
 * what is beside it, where Yes takes it away.
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
  /** What has the focus after Yes; without it what had it before. */
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
            // Only a trigger of the dialog's own would get it back by itself.
            event.preventDefault();
            const before = opener.current instanceof HTMLElement ? opener.current : null;
            const there = next.current ?? before;
            // Somebody else may have taken it away meanwhile.
            (there?.isConnected === true ? there : panes())?.focus();
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
