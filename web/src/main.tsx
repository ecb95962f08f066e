/** Where the page begins. */
import { createRoot } from "react-dom/client";
import { App } from "./app";
import "./i18n";
import "./styles/tokens.css";
import "./styles/base.css";
import "./styles/layout.css";
import "./styles/header.css";
import "./styles/sessions.css";
import "./styles/conversation.css";
import "./styles/question.css";
import "./styles/scene.css";
import "./styles/scene-bar.css";
import "./styles/camera.css";
import "./styles/overlays.css";
import "./styles/people.css";

const root = document.getElementById("root");
if (root === null) throw new Error("the page has no root element");
createRoot(root).render(<App />);
