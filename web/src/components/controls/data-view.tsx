/** A tool's data for people: names and values, and tables for lists of records; no brackets, no quotes. */
import { useTranslation } from "react-i18next";
import { clock } from "../../i18n/format";
import { argumentName } from "../../i18n/agent-terms";
import { isRecord } from "../../wire/fields";
import { visibleText } from "../../wire/visible-text";

/** Records nested deeper than this are written on one line. */
const MAX_DEPTH = 4;

/** Whether a number is a time in Unix seconds of this century: no length, angle or count of a robot is as large. */
function isTime(value: number): boolean {
  return value > 1e9 && value < 4e9;
}

function useText(): (value: unknown) => string {
  const { t } = useTranslation();
  const text = (value: unknown): string => {
    if (value === null || value === undefined || value === "") return t("tool.nothing");
    if (typeof value === "boolean") return t(value ? "tool.yes" : "tool.no");
    if (typeof value === "number")
      return isTime(value) ? clock(value) : String(Math.round(value * 1000) / 1000);
    if (typeof value === "string") return visibleText(value);
    if (Array.isArray(value)) return value.length === 0 ? t("tool.nothing") : value.map(text).join(", ");
    if (isRecord(value)) {
      return Object.entries(value)
        .map(([key, inner]) => `${argumentName(key)} ${text(inner)}`)
        .join(", ");
    }
    return "";
  };
  return text;
}

/** The language of a tool's text is unknown; every other value is written in the page's language. */
function languageOf(value: unknown): "" | undefined {
  return typeof value === "string" && value !== "" ? "" : undefined;
}

/** Whether all of it fits on one line of text. */
function isSmall(value: unknown): boolean {
  if (isRecord(value))
    return Object.values(value).every((inner) => !isRecord(inner) && !Array.isArray(inner));
  return !Array.isArray(value) || value.every((inner) => !isRecord(inner) && !Array.isArray(inner));
}

export function DataView({ value, depth = 0 }: { value: unknown; depth?: number }) {
  const text = useText();
  if (Array.isArray(value) && value.length > 0 && value.every(isRecord)) return <DataTable rows={value} />;
  if (isRecord(value) && depth < MAX_DEPTH && !(depth > 0 && isSmall(value))) {
    return (
      <dl className="data">
        {Object.entries(value).map(([key, inner]) => (
          <div key={key} data-block={!isSmall(inner)}>
            <dt>{argumentName(key)}</dt>
            <dd>
              <DataView value={inner} depth={depth + 1} />
            </dd>
          </div>
        ))}
      </dl>
    );
  }
  return <span lang={languageOf(value)}>{text(value)}</span>;
}

function DataTable({ rows }: { rows: Record<string, unknown>[] }) {
  const text = useText();
  const columns = [...new Set(rows.flatMap((row) => Object.keys(row)))].slice(0, 8);
  return (
    <div className="table-scroll">
      <table>
        <thead>
          <tr>
            {columns.map((column) => (
              <th key={column} scope="col">
                {argumentName(column)}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map((row, index) => (
            <tr key={index}>
              {columns.map((column) => (
                <td key={column} lang={languageOf(row[column])}>
                  {text(row[column])}
                </td>
              ))}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}
