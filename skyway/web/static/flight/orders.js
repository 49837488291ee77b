// What can be ordered of a flight now, who has command, and what became of each order.
import { h } from "vue";
import Hold from "skyway-flight/hold.js";

const WORDS = {
  pause: "Pause", go: "Resume", stay: "Stay at the next landing", return: "Return to the last stop", land: "Land here", leave: "Leave it alone",
  take: "Take command", give: "Give command", keep: "Keep command", yes: "Start: take off", y: "", no: "Do not take off", n: "", done: "The package is off", undelivered: "Not handed over: take it back",
};
const HELD = new Set(["land", "return", "leave", "divert", "yes", "done", "undelivered"]);
const TITLES = {
  undelivered: "The package goes back to where it came from, or where the plan says: nobody is there, or the place is blocked",
  leave: "The program ends; the drone does what its parameters say", stay: "It lands where it is going, and stays there",
};

export const said = (word) => WORDS[word] ?? (word.startsWith("divert ") ? `Divert to ${word.slice(7)}` : word);

function button(word, view, disabled) {
  const held = HELD.has(word.split(" ")[0]);
  const act = () => view.order(word);
  const main = word === "yes" || word === "go" ? "main" : word === "land" || word === "leave" ? "grave" : "";
  if (held) return h(Hold, { key: word, words: said(word), kind: main, disabled, told: TITLES[word], onHeld: act });
  return h("button", { key: word, type: "button", class: main, disabled, title: TITLES[word], onClick: act }, said(word));
}

export function commandLine(view) {
  const { live, mine } = view.flight;
  if (live.ended) return null;
  const { holder, asker, } = live;
  const who = holder ? (mine ? "You have command." : `${holder.name} has command; you watch.`) : "Nobody has command.";
  const parts = [h("b", who)];
  if (asker && mine) parts.push(h("span", { role: "alert", class: "warn" }, ` ${asker.name} asks for command. `), button("give", view), button("keep", view));
  else if (asker && asker.id === view.flight.me) parts.push(" You have asked for it: it is yours when it is given, or after 20 s without an answer.");
  else if (!mine) parts.push(" ", button("take", view));
  return h("div", { class: "line command-line" }, parts);
}

export function orderButtons(view) {
  const { live, mine } = view.flight;
  if (live.ended || !live.offered.length) return null;
  const plain = live.offered.filter((word) => WORDS[word] !== "" && !word.startsWith("divert ") && word !== "charged");
  const diverts = live.offered.filter((word) => word.startsWith("divert "));
  const parts = plain.map((word) => button(word, view, !mine));
  if (live.offered.includes("charged")) parts.unshift(charged(view, mine));
  return h("div", { class: "orders", role: "group", "aria-label": "Orders" }, [
    live.question ? h("p", { class: "question", role: "alert" }, live.question) : null,
    h("div", { class: "line" }, parts),
    diverts.length ? divert(view, diverts, mine) : null,
  ]);
}

function charged(view, mine) {
  const to = Math.round(100 * (view.flight.live.charge_to ?? 1));
  const value = view.charged ?? to;
  return h("span", { class: "line" }, [
    h("label", { for: "charged-to" }, "Charged to, %"),
    h("input", { id: "charged-to", type: "number", min: 0, max: 100, value, class: "narrow", onInput: (e) => (view.charged = e.target.value) }),
    h(Hold, { words: "Charged", kind: "main", disabled: !mine, onHeld: () => view.order(`charged ${value}`) }),
  ]);
}

function divert(view, words, mine) {
  const refuges = Object.fromEntries(view.flight.live.refuges.map((one) => [one.station, one]));
  const wanted = words.includes(view.wanted) ? view.wanted : words[0];
  const option = (word) => {
    const one = refuges[word.slice(7)];
    const told = one ? `: lands with ${Math.round(100 * one.soc_land)} % in ${Math.round(one.left_s / 60)} min` : "";
    return h("option", { value: word }, `${word.slice(7)}${told}`);
  };
  return h("div", { class: "line" }, [
    h("label", { for: "divert-to" }, "Land instead at"),
    h("select", { id: "divert-to", value: wanted, onChange: (e) => (view.wanted = e.target.value) }, words.map(option)),
    button(wanted, view, !mine),
  ]);
}

export function asked(view) {
  const rows = view.asked.slice(-4).map((one) => h("li", { key: one.id, class: one.wrong ? "warn" : "" }, `${said(one.word)}: ${one.told}`));
  return h("div", { class: "asked", role: "status", "aria-label": "What became of your orders" }, rows.length ? h("ul", rows) : null);
}
