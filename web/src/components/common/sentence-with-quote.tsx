import { visibleLine } from "../../wire/visible-text";

/**
 * A sentence of the page that quotes what a person, a model or a tool said. The quote's language is marked, so that a
 * screen reader does not read it in the page's language; HTML's `lang=""` means that the language is unknown. A quote that is
 * written from right to left does not turn the words around it.
 */
export function SentenceWithQuote(props: { sentence: string; quote: string; lang?: string }) {
  const { lang = "" } = props;
  const sentence = visibleLine(props.sentence);
  const quote = visibleLine(props.quote);
  const at = sentence.lastIndexOf(quote);
  if (quote === "" || at < 0) return sentence;
  return (
    <>
      {sentence.slice(0, at)}
      <bdi lang={lang}>{quote}</bdi>
      {sentence.slice(at + quote.length)}
    </>
  );
}
