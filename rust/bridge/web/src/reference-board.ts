// The page that prints the reference board.

import "./reference-board.css";
import { drawBoard } from "./reference";

document.getElementById("board")?.append(drawBoard());
document.getElementById("print")?.addEventListener("click", () => window.print());
