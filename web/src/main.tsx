/** Where the page begins. */
import { createRoot } from "react-dom/client";
import { signInOnLoad } from "./acp/connection/connection";
import { App } from "./app";
import { startPageLanguage } from "./i18n/page-language";
import "./styles/main.css";

startPageLanguage();
// Before anything is drawn: the token must not wait in the address until a slow machine has drawn the page.
void signInOnLoad();
// A login link that is opened in a tab where the page already is changes nothing but the fragment.
window.addEventListener("hashchange", () => {
  if (window.location.hash.includes("token=")) void signInOnLoad();
});

const root = document.getElementById("root");
if (root === null) throw new Error("the page has no root element");
createRoot(root).render(<App />);
