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
  if (!event.ctrlKey && !event.metaKey && event.target.closest?.("button, a, summary, canvas")) return; // a key of its own
  const keys = [event.ctrlKey || event.metaKey ? "ctrl" : "", event.shiftKey ? "shift" : "", event.key.toLowerCase()];
  const name = keys.filter(Boolean).join("+");
  const button = document.querySelector(`[data-keys="${CSS.escape(name)}"]`);
  if (!button || button.disabled) return;
  event.preventDefault();
  button.click();
});

// What has the focus may be drawn again, or go, by an answer of the server. What takes its place has the focus then, or what stands next to it: keys go on
// from where a person was. Never while a key is down: it would press what came.
const FOCUSABLE = "a[href], button:not(:disabled), input:not(:disabled), select:not(:disabled), textarea, summary, canvas[tabindex]";
let had = null;
let down = false;

function nameOf(element) {
  const { plan, item, flight } = element.dataset;
  const number = [plan, item, flight].find((one) => one !== undefined);
  return `${element.tagName} ${number === undefined ? element.getAttribute("aria-label") || element.textContent.trim() : `data ${number}`}`;
}

function passOn() {
  if (!had || down || had.element.isConnected || document.activeElement !== document.body) return;
  const near = had.around.find((one) => one.isConnected);
  const all = [...document.querySelectorAll(FOCUSABLE)].filter((one) => one.checkVisibility());
  const within = all.filter((one) => near?.contains(one));
  const after = all.find((one) => near && near.compareDocumentPosition(one) & Node.DOCUMENT_POSITION_FOLLOWING);
  const next = within.find((one) => nameOf(one) === had.name) || within[Math.min(had.number, within.length - 1)] || after;
  had = null;
  next?.focus({ preventScroll: true });
}

document.addEventListener("focusin", ({ target }) => {
  const around = [];
  for (let one = target.parentElement; one; one = one.parentElement) around.push(one);
  const number = [...(target.parentElement?.querySelectorAll(FOCUSABLE) || [])].indexOf(target);
  had = { element: target, name: nameOf(target), around, number: Math.max(0, number) };
});
document.addEventListener("focusout", ({ target }) => setTimeout(() => target.isConnected && had?.element === target && (had = null)));
document.addEventListener("keydown", () => (down = true), true);
document.addEventListener("keyup", () => ((down = false), setTimeout(passOn)), true);
window.addEventListener("blur", () => (down = false));
new MutationObserver(passOn).observe(document.documentElement, { childList: true, subtree: true });
