/**
 * A sentence of the page with words in it that are not the page's: what people, models and tools say. Their language is
 * marked, so that a screen reader does not read them with the voice of the page's; `lang=""` is HTML's "nobody knows".
 */
export function Quoting({ sentence, words, lang = "" }: { sentence: string; words: string; lang?: string }) {
  const at = sentence.lastIndexOf(words);
  if (words === "" || at < 0) return sentence;
  return (
    <>
      {sentence.slice(0, at)}
      <span lang={lang}>{words}</span>
      {sentence.slice(at + words.length)}
    </>
  );
}
