/** The types of pictures and sounds that the page puts into a `data:` URL. */

/** The type itself where a browser shows or plays it without executing anything (SVG can contain scripts); else any of its kind. */
export function safeType(mimeType: string, kind: "image" | "audio"): string {
  return new RegExp(`^${kind}/(?!svg)[\\w.+-]+$`).test(mimeType) ? mimeType : `${kind}/*`;
}
