/** A picture that the robot took; a click shows it large. */
import { X } from "lucide-react";
import { Dialog } from "radix-ui";
import { useTranslation } from "react-i18next";
import { safeType } from "../common/media-type";

export function Picture({ data, mimeType, title }: { data: string; mimeType: string; title: string }) {
  const { t } = useTranslation();
  const source = `data:${safeType(mimeType, "image")};base64,${data}`;
  const words = t("talk.picture", { title });
  return (
    <Dialog.Root>
      <Dialog.Trigger className="picture" aria-label={`${words}. ${t("talk.enlarge")}`}>
        <img src={source} alt={words} />
      </Dialog.Trigger>
      <Dialog.Portal>
        <Dialog.Overlay className="overlay" />
        <Dialog.Content className="lightbox" aria-describedby={undefined}>
          <Dialog.Title className="sr-only">{words}</Dialog.Title>
          <img src={source} alt={words} />
          <Dialog.Close className="icon-button lightbox-close" aria-label={t("talk.close")}>
            <X aria-hidden />
          </Dialog.Close>
        </Dialog.Content>
      </Dialog.Portal>
    </Dialog.Root>
  );
}
