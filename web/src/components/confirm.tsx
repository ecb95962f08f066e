/** Asks once before something that matters. The safe answer has the focus, which goes back to where it was. */
import { AlertDialog } from "radix-ui";
import { useRef } from "react";

export function Confirm(props: {
  open: boolean;
  onOpenChange: (open: boolean) => void;
  title: string;
  text: string;
  no: string;
  yes: string;
  onYes: () => void;
  danger?: boolean;
  testId?: string;
}) {
  const opener = useRef<Element | null>(null);
  return (
    <AlertDialog.Root open={props.open} onOpenChange={props.onOpenChange}>
      <AlertDialog.Portal>
        <AlertDialog.Overlay className="overlay" />
        <AlertDialog.Content
          className="dialog"
          onOpenAutoFocus={() => (opener.current = document.activeElement)}
          onCloseAutoFocus={(event) => {
            // Only a trigger of the dialog's own would get it back by itself.
            event.preventDefault();
            if (opener.current instanceof HTMLElement) opener.current.focus();
          }}
        >
          <AlertDialog.Title>{props.title}</AlertDialog.Title>
          <AlertDialog.Description>{props.text}</AlertDialog.Description>
          <div className="dialog-actions">
            <AlertDialog.Cancel className="button">{props.no}</AlertDialog.Cancel>
            <AlertDialog.Action
              className={props.danger === true ? "button danger" : "button primary"}
              data-testid={props.testId}
              onClick={props.onYes}
            >
              {props.yes}
            </AlertDialog.Action>
          </div>
        </AlertDialog.Content>
      </AlertDialog.Portal>
    </AlertDialog.Root>
  );
}
