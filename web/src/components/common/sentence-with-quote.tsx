/**
 * A sentence of the page that quotes what a person, a model or a tool said. The quote's language is marked, so that a
 * screen reader does not read it in the page's language; HTML's `lang=""` means that the language is unknown.
 */
export function SentenceWithQuote(props: { sentence: string; quote: string; lang?: string }) {
  const { sentence, quote, lang = "" } = props;
  const at = sentence.lastIndexOf(quote);
  if (quote === "" || at < 0) return sentence;
  return (
    <>
      {sentence.slice(0, at)}
      <span lang={lang}>{quote}</span>
      {sentence.slice(at + quote.length)}
    </>
  );
}
