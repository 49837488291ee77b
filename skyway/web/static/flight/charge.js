// The charge of the flight under way: as it was planned at the take-off, with its band, as it is, and as it is now expected to end.
import { h } from "vue";
import { clock, known, percent } from "skyway-flight/words.js";

const [W, H, LEFT, RIGHT, TOP, BOTTOM] = [620, 190, 44, 12, 14, 24];
const SHARE_80 = 1.2816; // of a normal distribution: eight of ten lie within so many standard deviations

export function chargeChart(view) {
  const { live, points } = view.flight;
  const leg = live.leg;
  if (!leg || !known(leg.start_s) || !known(leg.soc)) return null;
  const left = live.expected?.left_s;
  const now = live.time_s;
  const end = Math.max(leg.start_s + (leg.planned_s || 0), known(left) ? now + left : now, leg.start_s + 60);
  const flown = points.filter(([, t, , , soc]) => t >= leg.start_s - 1 && known(soc));
  const x = (t) => LEFT + ((W - LEFT - RIGHT) * (t - leg.start_s)) / (end - leg.start_s);
  const y = (soc) => TOP + (H - TOP - BOTTOM) * (1 - Math.max(0, Math.min(1, soc)));
  const at = (t, soc) => `${x(t).toFixed(1)} ${y(soc).toFixed(1)}`;
  const lands = leg.start_s + leg.planned_s;
  const spread = known(leg.planned_soc_sd) ? SHARE_80 * leg.planned_soc_sd : 0;
  const parts = [];
  for (const soc of [0, 0.25, 0.5, 0.75, 1]) {
    parts.push(h("path", { class: "grid", d: `M${LEFT} ${y(soc)}H${W - RIGHT}` }));
    parts.push(h("text", { class: "tick", x: LEFT - 6, y: y(soc) + 4, "text-anchor": "end" }, percent(soc)));
  }
  if (known(leg.planned_soc)) {
    parts.push(h("path", { class: "fan outer", d: `M${at(leg.start_s, leg.soc)}L${at(lands, leg.planned_soc + spread)}L${at(lands, leg.planned_soc - spread)}Z` }));
    parts.push(h("path", { class: "planned", d: `M${at(leg.start_s, leg.soc)}L${at(lands, leg.planned_soc)}` }));
  }
  if (known(live.reserve_soc)) {
    parts.push(h("path", { class: "reserve", d: `M${LEFT} ${y(live.reserve_soc)}H${W - RIGHT}` }));
    parts.push(h("text", { class: "mark-name", x: LEFT + 4, y: y(live.reserve_soc) - 4 }, `reserve ${percent(live.reserve_soc)}`));
  }
  if (flown.length) parts.push(h("path", { class: "typical", d: `M${flown.map(([, t, , , soc]) => at(t, soc)).join("L")}` }));
  const expected = live.expected?.soc_land;
  if (known(left) && known(expected) && flown.length) {
    parts.push(h("path", { class: "ahead", d: `M${at(now, live.vehicle.soc ?? flown.at(-1)[4])}L${at(now + left, expected)}` }));
    parts.push(h("circle", { class: "ends", cx: x(now + left), cy: y(expected), r: 4 }));
  }
  for (const [t, anchor] of [[leg.start_s, "start"], [end, "end"]]) {
    parts.push(h("text", { class: "tick", x: x(t), y: H - 6, "text-anchor": anchor }, clock(t, view)));
  }
  const words = `Charge: now ${percent(live.vehicle.soc)}, expected at the landing ${percent(expected)}, planned ${percent(leg.planned_soc)}, reserve ${percent(live.reserve_soc)}`;
  return h("figure", [
    h("figcaption", { class: "faint" }, "Charge of this flight: measured; planned (dashed) with its band of eight in ten; expected from now on (dotted)"),
    h("svg", { class: "chart", viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": words }, parts),
  ]);
}
