/** Mode and model of the session, as the agent offers them. */
import { Check, ChevronDown } from "lucide-react";
import { Select } from "radix-ui";
import { useTranslation } from "react-i18next";
import { choose } from "../acp/sessions";
import { canConfigure } from "../state/rights";
import { modelSetting, modeSetting, type Setting } from "../state/settings";
import { useConversation, useMe, useStore } from "../state/store";
import { QuestionSettings } from "./question-settings";

export function SettingSelects() {
  const { t } = useTranslation();
  const conversation = useConversation();
  const me = useMe();
  const ready = useStore((state) => state.currentId !== null && state.attached.has(state.currentId));
  const disabled = !ready || !canConfigure(me.role);
  const mode = modeSetting(conversation);
  const model = modelSetting(conversation);
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
  return (
    <Select.Root
      value={setting.current}
      onValueChange={(value) => void choose(setting, value)}
      disabled={disabled}
    >
      <Select.Trigger
        className="select"
        data-testid={`select-${props.testId}`}
        aria-label={`${label}: ${current}`}
        title={disabled && !canConfigure(me.role) ? t("settings.readOnly") : current}
      >
        <span className="select-label">{label}</span>
        <span className="select-value">
          <Select.Value>{current}</Select.Value>
        </span>
        <ChevronDown aria-hidden className="select-arrow" />
      </Select.Trigger>
      <Select.Portal>
        <Select.Content className="menu select-menu" position="popper" sideOffset={4} collisionPadding={8}>
          <Select.Viewport>
            {setting.choices.map((choice) => (
              <Select.Item
                key={choice.value}
                value={choice.value}
                textValue={choice.name}
                className="menu-item select-item"
              >
                <Select.ItemIndicator className="select-check">
                  <Check aria-hidden />
                </Select.ItemIndicator>
                <Select.ItemText>
                  <span>{choice.name}</span>
                  {choice.description !== null && (
                    <span className="select-description">{choice.description}</span>
                  )}
                </Select.ItemText>
              </Select.Item>
            ))}
          </Select.Viewport>
        </Select.Content>
      </Select.Portal>
    </Select.Root>
  );
}
