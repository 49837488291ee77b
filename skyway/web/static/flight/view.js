// One flight: alarms, where it stands, what is to come, the checklist before a take-off, what has been decided and said.
import { h } from "vue";
import { chargeChart } from "skyway-flight/charge.js";
import { asked, commandLine, orderButtons } from "skyway-flight/orders.js";
import { clock, duration, figure, inWords, known, percent, probability, wind, zoneName } from "skyway-flight/words.js";

const BAD = new Set(["lost-link", "holding", "crashed", "landed-elsewhere", "left-to-itself"]);
const GRAVE = new Set(["emergency", "alert", "critical", "error"]);
const RISK = 0.01;
const ROWS = 80;

export function alarms(told) {
  const { live, runs, age_s } = told;
  const found = [];
  if (!live.ended && !runs) found.push("The program of this flight has ended before the delivery did: nobody supervises it.");
  else if (!live.ended && age_s > 10) found.push(`The program of this flight has said nothing for ${duration(age_s)}.`);
  if (live.problem) found.push(live.problem);
  if (BAD.has(live.state)) found.push(`${live.state}: ${live.doing}`);
  if (!live.ended && live.vehicle.silent_s > 5) found.push(`Nothing has been heard from the drone for ${duration(live.vehicle.silent_s)}.`);
  if (live.expected.p_below_reserve > RISK) found.push(`It lands below the reserve with probability ${probability(live.expected.p_below_reserve)}.`);
  if (live.expected.limited) found.push(live.expected.limited);
  return [...found, ...(live.vehicle.traffic || [])];
}

export function flightView(view) {
  const { live } = view.flight;
  return h("div", { class: "flight" }, [
    alarmBox(view),
    h("p", { class: "big" }, [h("span", { class: "state" }, live.paused ? "paused" : live.state), live.origin ? ` ${live.origin} > ${live.destination}` : ` ${view.flight.name}`]),
    h("p", { class: "faint" }, inWords(live.doing, view)),
    commandLine(view),
    orderButtons(view),
    asked(view),
    live.ended ? ending(view) : null,
    departure(view),
    figures(view),
    chargeChart(view),
    ahead(view),
    list("Decisions", rowsOf(view, (row) => row.event === "decision"), view),
    list("Messages of the autopilot", rowsOf(view, (row) => row.event === "text"), view),
    list("All events", rowsOf(view, (row) => row.event !== "text"), view),
  ]);
}

function alarmBox(view) {
  const found = alarms(view.flight);
  const resume = !view.flight.runs && !(view.flight.live.ended && !view.flight.live.problem);
  return h("div", { class: found.length ? "alarms" : "", role: "alert" }, [
    ...found.map((words) => h("p", { key: words }, ["! ", inWords(words, view)])),
    resume && found.length ? h("button", { type: "button", class: "main", onClick: () => view.$emit("resume", view.flight.name) }, "Continue this flight") : null,
  ]);
}

function ending(view) {
  const { name, live, printed } = view.flight;
  return h("div", [
    h("p", h("a", { href: `/replay?log=${encodeURIComponent(`${name}.jsonl`)}` }, "Replay this flight")),
    live.problem && printed ? h("pre", { class: "output" }, printed) : null,
  ]);
}

function departure(view) {
  const { live } = view.flight;
  if (!["connecting", "preflight", "uploading", "ready", "stopped-safe"].includes(live.state) || !live.checks.length) return null;
  const marks = { ok: ["✓", "in order"], no: ["✗", "NOT in order"], unknown: ["?", "not known"] };
  const rows = live.checks.map((one) => {
    const [sign, words] = marks[one.verdict] || ["?", one.verdict];
    return h("tr", { key: one.name, class: one.verdict === "ok" ? "" : "warn" }, [
      h("td", [h("span", { "aria-hidden": "true" }, sign), h("span", { class: "only-heard" }, words)]),
      h("td", one.name),
      h("td", inWords(one.said, view)),
    ]);
  });
  const head = h("tr", ["", "check", "found"].map((name, i) => (i ? h("th", name) : h("td"))));
  const parts = [h("h2", "Before the take-off"), h("div", { class: "scroll" }, h("table", { class: "checks" }, [h("thead", head), h("tbody", rows)]))];
  if (live.parameters.length) {
    const set = live.parameters.map((one) => h("tr", { key: one.name }, [h("td", one.name), h("td", { class: "n" }, String(one.now)), h("td", { class: "n" }, String(one.then)), h("td", one.why)]));
    const names = h("tr", [h("th", "parameter"), h("th", { class: "n" }, "now"), h("th", { class: "n" }, "then"), h("th", "why")]);
    parts.push(h("h2", "Parameters that the take-off sets, and the end restores"), h("div", { class: "scroll" }, h("table", { class: "parameters" }, [h("thead", names), h("tbody", set)])));
  }
  if (live.brief.length) parts.push(h("h2", "What is decided"), h("ul", { class: "notes" }, live.brief.map((line) => h("li", { key: line }, inWords(line.trim(), view)))));
  return h("section", { "aria-label": "Before the take-off" }, parts);
}

function figures(view) {
  const { live } = view.flight;
  const { vehicle, expected, leg } = live;
  const radio = vehicle.radios?.length ? vehicle.radios.join("; ").replace(/^radio: /, "") : known(vehicle.loss) ? `${Math.round(100 * (1 - vehicle.loss))} % received` : "unknown";
  const cells = [
    ["charge", percent(vehicle.soc), live.charge_to && !known(expected.left_s) ? `to be charged to ${percent(live.charge_to)}` : ""],
    ["at the landing", percent(expected.soc_land), known(expected.soc_land) ? `planned ${percent(expected.planned_soc_land)}` : ""],
    ["below the reserve", known(expected.p_below_reserve) ? probability(expected.p_below_reserve) : "unknown", ""],
    ["lands in", duration(expected.left_s), known(expected.late_s) ? `${duration(expected.late_s, true)} against the plan` : ""],
    ["ground speed", figure(vehicle.ground_speed_mps, view.speedFactor, view.speedUnit, 1), known(expected.commanded_mps) ? `commanded ${figure(expected.commanded_mps, view.speedFactor, view.speedUnit, 1)}` : ""],
    ["height", figure(vehicle.height_m, view.heightFactor, view.heightUnit), "above home"],
    ["wind measured", wind(live.wind.measured, view), `forecast ${wind(live.wind.expected, view)}`],
    ["off the route", figure(expected.cross_track_m, view.heightFactor, view.heightUnit), ""],
    ["mode", vehicle.mode || "unknown", vehicle.armed ? "armed" : "disarmed"],
    ["radio", radio, known(vehicle.silent_s) && vehicle.silent_s > 2 ? `silent for ${duration(vehicle.silent_s)}` : ""],
  ];
  const shown = leg && known(expected.left_s) ? cells : cells.filter(([name]) => ["charge", "mode", "radio", "wind measured"].includes(name));
  return h("dl", { class: "figures" }, shown.map(([name, value, small]) => h("div", { key: name }, [h("dt", name), h("dd", { class: "small-dd" }, [value, small ? h("span", { class: "small" }, small) : null])])));
}

// Time to each event: the landing under way by what is expected of it, the rest by the plan in force, as late as that landing is.
function ahead(view) {
  const { live, plan } = view.flight;
  if (!plan || live.ended || !known(live.time_s)) return null;
  const now = live.time_s;
  const rows = [];
  let late = 0;
  let more = 0; // charge that the drone leaves with, above what the plan has
  const first = plan.legs[0];
  if (known(live.expected.left_s) && live.leg) {
    const lands = now + live.expected.left_s;
    rows.push([`lands at ${live.leg.to}`, lands, live.expected.soc_land]);
    late = first && first.to === live.leg.to && known(first.arrive_s) ? lands - first.arrive_s : 0;
  } else if (first && known(first.depart_s)) {
    late = Math.max(0, now - first.depart_s);
    more = Math.max(0, (live.charge_to || 0) - first.soc_depart);
  }
  plan.legs.forEach((leg, i) => {
    const flying = i === 0 && known(live.expected.left_s);
    if (!flying && known(leg.depart_s)) rows.push([`leaves ${leg.from}`, leg.depart_s + late, leg.soc_depart + (i ? 0 : more)]);
    if (!flying && known(leg.arrive_s)) rows.push([`lands at ${leg.to}`, leg.arrive_s + late, leg.soc_arrive + (i ? 0 : more)]);
  });
  if (!rows.length) return null;
  const body = rows.map(([words, at, soc], i) => h("tr", { key: `${i} ${words}` }, [h("td", words), h("td", { class: "n" }, at > now ? duration(at - now) : "when decided"), h("td", { class: "n" }, clock(at, view)), h("td", { class: "n" }, percent(soc))]));
  const head = h("tr", [h("th", "what is to come"), h("th", { class: "n" }, "in"), h("th", { class: "n" }, zoneName(now, view)), h("th", { class: "n" }, "charge")]);
  return h("div", { class: "scroll" }, h("table", { class: "ahead" }, [h("thead", head), h("tbody", body)]));
}

function rowsOf(view, keep) {
  return view.flight.rows.filter(keep).slice(-ROWS).reverse();
}

function list(title, rows, view) {
  if (!rows.length) return null;
  const items = rows.map((row) => {
    const grave = GRAVE.has(row.severity) || row.done === "refused" || row.done === "failed";
    const head = row.event === "decision" ? `${row.action}: ` : row.severity ? `${row.severity}: ` : "";
    return h("li", { key: row.n, class: grave ? "warn" : "" }, [h("time", clock(row.t, view)), ` ${head}${inWords(row.text, view)}`]);
  });
  return h("details", { open: title === "Decisions" }, [h("summary", title), h("ol", { class: "events", tabindex: 0, "aria-label": title }, items)]);
}
