// What every page does by itself: colours and units as chosen before, shortcuts, copying of commands.
"use strict";

const chosen = (name) => document.cookie.match(new RegExp(`(?:^|; )skyway_${name}=([^;]*)`))?.[1];

function keep(name, value) {
  document.cookie = `skyway_${name}=${value}; Path=/; SameSite=Strict; Max-Age=31536000`;
}

// The style sheet and the map know light and dark; "as the system" is one of them.
const system = matchMedia("(prefers-color-scheme: dark)");

function theme(name) {
  document.documentElement.dataset.theme = name === "light" || name === "dark" ? name : system.matches ? "dark" : "light";
}

theme(chosen("theme"));
system.addEventListener("change", () => theme(chosen("theme")));

document.addEventListener("change", (event) => {
  const { preference } = event.target.dataset || {};
  if (!preference) return;
  keep(preference, event.target.value);
  if (preference === "theme") theme(event.target.value);
  else window.location.reload();
});

document.addEventListener("click", async (event) => {
  const button = event.target.closest?.("[data-copy]");
  if (!button) return;
  const text = document.getElementById(button.dataset.copy)?.textContent || "";
  try {
    await navigator.clipboard.writeText(text);
    button.textContent = "Copied";
  } catch {
    getSelection().selectAllChildren(document.getElementById(button.dataset.copy));
  }
  setTimeout(() => (button.textContent = "Copy"), 1500);
});

// Ctrl+Z and such press the button that names them, unless a person is typing.
document.addEventListener("keydown", (event) => {
  if (event.target.closest?.("input, textarea, select")) return;
  const keys = [event.ctrlKey || event.metaKey ? "ctrl" : "", event.shiftKey ? "shift" : "", event.key.toLowerCase()];
  const name = keys.filter(Boolean).join("+");
  const button = document.querySelector(`[data-keys="${CSS.escape(name)}"]`);
  if (!button || button.disabled) return;
  event.preventDefault();
  button.click();
});
