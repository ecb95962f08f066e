/** Text with markdown, in an unknown language. What a model writes is not trusted: no HTML, no pictures from elsewhere, links only to the web. */
import type { ReactNode } from "react";
import ReactMarkdown, { type Components } from "react-markdown";
import remarkGfm from "remark-gfm";
import { visibleLine, visibleText } from "../../wire/visible-text";

const PLUGINS = [remarkGfm];

const COMPONENTS: Components = {
  a: ({ href, children }): ReactNode =>
    href !== undefined && /^(https?:|mailto:)/i.test(href) ? (
      <a href={href} target="_blank" rel="noopener noreferrer nofollow">
        {children}
        <LinkTarget href={href} />
      </a>
    ) : (
      <span>{children}</span>
    ),
  img: ({ alt }): ReactNode => <span>{alt}</span>,
  // A wide table scrolls by itself; the page never scrolls sideways.
  table: ({ children }): ReactNode => (
    <div className="table-scroll">
      <table>{children}</table>
    </div>
  ),
};

/** Where a link leads, whatever its words say. */
function LinkTarget({ href }: { href: string }) {
  const target = URL.canParse(href) ? new URL(href) : null;
  const place = target?.protocol === "mailto:" ? decodedAddress(target) : (target?.host ?? href);
  return <span className="link-host"> ({visibleLine(place)})</span>;
}

function decodedAddress({ pathname }: URL): string {
  try {
    return decodeURIComponent(pathname);
  } catch {
    return pathname;
  }
}

export default function Markdown({ text }: { text: string }) {
  return (
    <div className="markdown" lang="">
      <ReactMarkdown remarkPlugins={PLUGINS} components={COMPONENTS} skipHtml>
        {visibleText(text)}
      </ReactMarkdown>
    </div>
  );
}
