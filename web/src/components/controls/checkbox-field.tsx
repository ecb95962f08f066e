/** A checkbox with its label. */
import { Check } from "lucide-react";
import { Checkbox } from "radix-ui";
import { useId } from "react";

export function CheckboxField(props: {
  label: string;
  checked: boolean;
  onChange: (checked: boolean) => void;
  testId: string;
}) {
  const id = useId();
  return (
    <div className="check">
      <Checkbox.Root
        id={id}
        className="checkbox"
        checked={props.checked}
        onCheckedChange={(value) => props.onChange(value === true)}
        data-testid={props.testId}
      >
        <Checkbox.Indicator>
          <Check aria-hidden />
        </Checkbox.Indicator>
      </Checkbox.Root>
      <label htmlFor={id}>{props.label}</label>
    </div>
  );
}
