/** The entry of the page. */
import { createRoot } from "react-dom/client";
import { signInOnLoad } from "./acp/connection/connection";
import { App } from "./app";
import { startPageLanguage } from "./i18n/page-language";
import "./styles/main.css";

startPageLanguage();
// Before anything is drawn: the token must not stay in the address while a slow machine draws the page.
void signInOnLoad();
// A login link that is opened in a tab with this page changes only the fragment of the address.
window.addEventListener("hashchange", () => {
  if (window.location.hash.includes("token=")) void signInOnLoad();
});

const root = document.getElementById("root");
if (root === null) throw new Error("the page has no root element");
createRoot(root).render(<App />);
