// Lines over time as SVG, with an upright mark at the time shown. A click goes there.
import { h } from "vue";

const [WIDTH, HEIGHT, LEFT] = [420, 72, 44];
const TITLES = { height_m: "height", soc: "charge", ground_speed_mps: "ground speed", wind: "wind, with its error" };

function values(log, name) {
  const c = log.columns;
  if (name !== "wind") return c[name];
  return c.wind_north_mps.map((north, i) => (north === null ? null : Math.hypot(north, c.wind_east_mps[i])));
}

export function lines(logs, name, end, units) {
  const factor = { height_m: units.heightFactor, soc: 100 }[name] ?? units.speedFactor;
  const unit = { height_m: units.heightUnit, soc: "%" }[name] ?? units.speedUnit;
  const all = logs.map((log) => values(log, name).map((v) => (v === null ? null : v * factor)));
  const known = all.flat().filter((v) => v !== null);
  if (!known.length) return { name, title: `${TITLES[name]}: unknown`, paths: [] };
  const [low, high] = name === "soc" ? [0, 100] : known.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Math.min(0, known[0]), known[0] + 1e-6]);
  const x = (t) => LEFT + ((WIDTH - LEFT) * t) / end;
  const y = (v) => HEIGHT - 4 - ((HEIGHT - 12) * (v - low)) / (high - low);
  const paths = all.map((course, i) => path(logs[i].columns.time_s, course, x, y));
  const sigma = name === "wind" ? logs[0].columns.wind_sigma_mps : null;
  const band = sigma ? area(logs[0].columns.time_s, all[0], sigma, factor, x, y) : "";
  return { name, title: `${TITLES[name]}, ${unit}`, paths, band, low: low.toFixed(0), high: high.toFixed(0) };
}

function path(times, course, x, y) {
  const every = Math.max(1, Math.floor(times.length / 1500));
  let out = "";
  let open = false;
  for (let i = 0; i < times.length; i += every) {
    if (course[i] === null) open = false;
    else {
      out += `${open ? "L" : "M"}${x(times[i]).toFixed(1)} ${y(course[i]).toFixed(1)}`;
      open = true;
    }
  }
  return out;
}

function area(times, course, sigma, factor, x, y) {
  const every = Math.max(1, Math.floor(times.length / 600));
  let [out, up, down] = ["", [], []];
  const close = () => {
    if (up.length > 1) out += `M${[...up, ...down.reverse()].join("L")}Z`;
    [up, down] = [[], []];
  };
  for (let i = 0; i < times.length; i += every) {
    if (course[i] === null || sigma[i] === null) {
      close();
      continue;
    }
    up.push(`${x(times[i]).toFixed(1)} ${Math.max(4, y(course[i] + sigma[i] * factor)).toFixed(1)}`);
    down.push(`${x(times[i]).toFixed(1)} ${y(Math.max(course[i] - sigma[i] * factor, 0)).toFixed(1)}`);
  }
  close();
  return out;
}

export function marks(one, share, go) {
  const at = LEFT + (WIDTH - LEFT) * share;
  const click = (e) => {
    const box = e.currentTarget.getBoundingClientRect();
    go(Math.max(0, Math.min(1, (((e.clientX - box.left) / box.width) * WIDTH - LEFT) / (WIDTH - LEFT))));
  };
  const parts = [
    h("path", { class: "fan outer", d: one.band || "M0 0" }),
    ...one.paths.map((d, i) => h("path", { class: `typical trace-${i}`, d: d || "M0 0" })),
    h("path", { class: "mark", d: `M${at.toFixed(1)} 4V${HEIGHT}` }),
    h("text", { class: "tick", x: LEFT - 6, y: 13, "text-anchor": "end" }, one.high),
    h("text", { class: "tick", x: LEFT - 6, y: HEIGHT - 2, "text-anchor": "end" }, one.low),
  ];
  return h("figure", { key: one.name }, [
    h("figcaption", { class: "faint" }, one.title),
    h("svg", { class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${one.title} over time`, onClick: click }, parts),
  ]);
}
