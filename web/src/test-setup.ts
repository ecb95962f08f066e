/** What every test of a component needs: the texts, and a clean page after it. */
import "./i18n";
import { cleanup, configure } from "@testing-library/react";
import { afterEach, vi } from "vitest";

// Every wait is for a condition; how long it takes says how busy the machine is.
configure({ asyncUtilTimeout: 30_000 });
vi.setConfig({ testTimeout: 60_000 });

afterEach(cleanup);
