/** Mode and model of the session, as the agent offers them. */
import { Check, ChevronDown } from "lucide-react";
import { DropdownMenu } from "radix-ui";
import { useTranslation } from "react-i18next";
import { applySetting } from "../../acp/sessions/sessions";
import { canConfigure } from "../../state/rights";
import { modelSetting, modeSetting, type Setting } from "../../state/conversation/settings";
import { conversationOf, useMe, useStore } from "../../state/store";
import { QuestionSettings } from "../questions/question-settings";

export function SettingSelects() {
  const { t } = useTranslation();
  const me = useMe();
  const ready = useStore((state) => state.currentId !== null && state.attached.has(state.currentId));
  const disabled = !ready || !canConfigure(me.role);
  const modes = useStore((state) => conversationOf(state).modes);
  const options = useStore((state) => conversationOf(state).options);
  const mode = modeSetting({ modes, options });
  const model = modelSetting({ modes, options });
  return (
    <>
      {mode && <SettingSelect testId="mode" label={t("settings.mode")} setting={mode} disabled={disabled} />}
      {model && (
        <SettingSelect testId="model" label={t("settings.model")} setting={model} disabled={disabled} />
      )}
      <QuestionSettings />
    </>
  );
}

function SettingSelect(props: { testId: string; label: string; setting: Setting; disabled: boolean }) {
  const { t } = useTranslation();
  const { label, setting, disabled } = props;
  const me = useMe();
  const current = setting.choices.find(({ value }) => value === setting.current)?.name ?? setting.current;
  // Not modal: a modal menu hides the rest of the page from screen readers, also the button that names the menu.
  return (
    <DropdownMenu.Root modal={false}>
      <DropdownMenu.Trigger
        className="select"
        data-testid={`select-${props.testId}`}
        aria-label={`${label} ${current}`}
        title={disabled && !canConfigure(me.role) ? t("settings.readOnly") : current}
        disabled={disabled}
      >
        <span className="select-label">{label}</span> <span className="select-value">{current}</span>
        <ChevronDown aria-hidden className="select-arrow" />
      </DropdownMenu.Trigger>
      <DropdownMenu.Portal>
        <DropdownMenu.Content className="menu select-menu" align="start" sideOffset={4} collisionPadding={8}>
          <DropdownMenu.RadioGroup
            value={setting.current}
            onValueChange={(value) => void applySetting(setting, value)}
          >
            {setting.choices.map((choice) => (
              <DropdownMenu.RadioItem
                key={choice.value}
                value={choice.value}
                textValue={choice.name}
                className="menu-item select-item"
              >
                <DropdownMenu.ItemIndicator className="select-check">
                  <Check aria-hidden />
                </DropdownMenu.ItemIndicator>
                <span>
                  <span>{choice.name}</span>
                  {choice.description !== null && (
                    <span className="select-description">{choice.description}</span>
                  )}
                </span>
              </DropdownMenu.RadioItem>
            ))}
          </DropdownMenu.RadioGroup>
        </DropdownMenu.Content>
      </DropdownMenu.Portal>
    </DropdownMenu.Root>
  );
}
