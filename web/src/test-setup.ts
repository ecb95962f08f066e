/** What every test of a component needs: the texts, and a clean page after it. */
import "./i18n";
import { cleanup } from "@testing-library/react";
import { afterEach } from "vitest";

afterEach(cleanup);
