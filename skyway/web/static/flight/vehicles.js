// Vehicles that are heard: what of them is on the map, and the table.
import { h } from "vue";
import { figure } from "skyway-flight/words.js";

const ROWS = 60;
const SILENT_S = 5;

export const keyOf = (one) => `${one.connection} ${one.system}`;

export function onMap(found, courses) {
  return found
    .filter((one) => one.lat !== null && one.lon !== null)
    .map((one) => ({ id: keyOf(one), name: String(one.system), lat: one.lat, lon: one.lon, heading_deg: course(one, courses), stale: one.age_s + one.silent_s > SILENT_S }));
}

// A vehicle on the map points to where it moves.
export function turn(one, [lat, lon]) {
  if (one.lat === lat && one.lon === lon) return;
  const east = (lon - one.lon) * Math.cos((lat * Math.PI) / 180);
  one.heading_deg = ((Math.atan2(east, lat - one.lat) * 180) / Math.PI + 360) % 360;
}

// Where it moved since the digest before; vehicles do not tell their course in a watch.
function course(one, courses) {
  const known = courses.get(keyOf(one));
  let found = known?.course ?? 0;
  if (known && (known.lat !== one.lat || known.lon !== one.lon)) {
    const east = (one.lon - known.lon) * Math.cos((one.lat * Math.PI) / 180);
    found = ((Math.atan2(east, one.lat - known.lat) * 180) / Math.PI + 360) % 360;
  }
  courses.set(keyOf(one), { lat: one.lat, lon: one.lon, course: found });
  return found;
}

function row(one, view) {
  const silent = one.age_s + one.silent_s > SILENT_S;
  const show = () => one.lat !== null && window.skywayMap?.set({ centre: [one.lat, one.lon] });
  const wind = one.wind_mps === null ? "unknown" : `${figure(one.wind_mps, view.speedFactor, view.speedUnit, 1)} from ${one.wind_from_deg}°`;
  return h("tr", { key: keyOf(one) }, [
    h("td", h("button", { type: "button", class: "plain", onClick: show }, `${one.system} ${one.autopilot}`)),
    h("td", `${one.mode}${one.armed ? ", armed" : ""}`),
    h("td", { class: "n" }, figure(one.height_m, view.heightFactor, view.heightUnit)),
    h("td", { class: "n" }, figure(one.ground_speed_mps, view.speedFactor, view.speedUnit, 1)),
    h("td", { class: "n" }, figure(one.soc, 100, "%")),
    h("td", wind),
    h("td", one.item === null ? one.mission : `item ${one.item} ${one.mission}`),
    h("td", { class: silent ? "warn" : "" }, silent ? `silent for ${Math.round(one.age_s + one.silent_s)} s` : `${Math.round(100 * (1 - one.loss))} %`),
    h("td", { class: one.doubts.length ? "warn" : "" }, one.doubts.join("; ")),
  ]);
}

export function vehicleTable(found, view) {
  const words = view.sought.toLowerCase();
  const shown = found.filter((one) => !words || JSON.stringify(one).toLowerCase().includes(words));
  const search =
    found.length > 8
      ? h("div", { class: "field" }, [
          h("label", { for: "fleet-search" }, "Search"),
          h("input", { id: "fleet-search", type: "search", value: view.sought, onInput: (e) => (view.sought = e.target.value) }),
        ])
      : null;
  if (!shown.length) return [search, h("p", { class: "faint" }, "No vehicle is heard. Name a connection and press Watch.")];
  const names = ["vehicle", "mode", "height", "speed", "charge", "wind", "mission", "link", "doubts"];
  const head = h("tr", names.map((name) => h("th", { class: ["height", "speed", "charge"].includes(name) ? "n" : "" }, name)));
  const more = shown.length > ROWS ? h("p", { class: "faint" }, `${shown.length - ROWS} more: search to narrow them`) : null;
  return [search, h("div", { class: "scroll" }, h("table", [h("thead", head), h("tbody", shown.slice(0, ROWS).map((one) => row(one, view)))])), more];
}
