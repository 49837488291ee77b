// What the canvas shows, from the bottom up. Colours come from the page's style sheet, so that dark and light agree.
import { shaded } from "skyway-map/ground.js";
import { attribution } from "skyway-map/tiles.js";
import { streetWidth } from "skyway-map/vectors.js";
import { mercator } from "skyway-map/view.js";

const NAMES = ["water", "land", "street", "grid", "segment", "zone", "zone-fill", "station", "ink", "paper", "faint", "wind", "route", "other", "start", "target", "vehicle", "warn", "halo"];

const MPS_PX = 2.2; // of a wind arrow, for each m/s

export function palette(root) {
  const style = getComputedStyle(root);
  return Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--map-${name}`).trim() || "gray"]));
}

export function draw(context, view, state, colours, map) {
  const c = context;
  c.lineJoin = "round";
  c.lineCap = "round";
  c.fillStyle = colours.water;
  c.fillRect(0, 0, view.width, view.height);
  if (state.base?.high !== undefined && state.layers.base !== false) map.tiles.draw(c, view, state.base, colours);
  if (state.outline) outline(c, view, state.outline, colours);
  if (state.ground?.heights_m && state.layers.ground !== false) shaded(c, view, state.ground, map.colours);
  graticule(c, view, colours);
  const { region } = state;
  if (region && state.layers.zones !== false) zones(c, view, region.zones, colours);
  if (region) segments(c, view, region, state, colours);
  if (state.wind && state.layers.wind !== false) wind(c, view, state, colours);
  state.plans.forEach((plan, number) => number !== state.chosen && route(c, view, plan, colours.other, 2, [5, 4]));
  if (state.plans[state.chosen]) chosen(c, view, state.plans[state.chosen], colours);
  if (state.proposed?.length) path(c, view, state.proposed, colours.route, 3, [2, 6]);
  for (const track of state.tracks) path(c, view, track.points, colours[track.colour] || colours.vehicle, track.width || 2, track.dash || []);
  const taken = [];
  if (region) stations(c, view, state, colours, map, taken);
  marks(c, view, state.marks || [], colours);
  reach(c, view, state, colours, taken);
  vehicles(c, view, state.vehicles, colours, taken);
  if (state.base?.kind === "vectors" && state.layers.base !== false) places(c, view, map.tiles.names, colours, taken);
  ends(c, view, state, colours);
  for (const moved of [map.dragged, map.carried]) if (moved?.x !== undefined) ghost(c, view, state, moved, colours);
  if (map.canvas.matches(":focus-visible")) aim(c, map, colours);
  scaleBar(c, view, colours, map.feet);
  if (state.base?.attribution) attribution(c, state.base, colours);
}

function outline(c, view, found, colours) {
  found.projected ||= project(found);
  for (const { kind, words, rings, closed } of found.projected) {
    c.beginPath();
    for (const ring of rings) {
      ring.forEach((point, i) => c[i ? "lineTo" : "moveTo"](...view.place(point)));
      if (closed) c.closePath();
    }
    if (closed) {
      c.fillStyle = kind === "water" ? colours.water : colours.land;
      c.fill("evenodd");
    }
    c.strokeStyle = kind !== "water" ? colours.street : closed ? colours.grid : colours.segment;
    c.lineWidth = closed ? 0.6 : kind === "street" ? streetWidth(words) : 1.2;
    c.stroke();
  }
}

function project(found) {
  return found.shapes.map(({ kind, words, rings, closed }) => ({
    kind,
    words,
    closed,
    rings: rings.map((ring) => ring.map(([lon, lat]) => mercator(lat, lon))),
  }));
}

function graticule(c, view, colours) {
  const [north, west] = view.toWorld(0, 0);
  const [south, east] = view.toWorld(view.width, view.height);
  const step = [30, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001].find((s) => (east - west) / s > 5) || 0.001;
  c.strokeStyle = colours.grid;
  c.fillStyle = colours.faint;
  c.lineWidth = 0.5;
  c.font = "11px system-ui, sans-serif";
  c.beginPath();
  const digits = Math.max(0, Math.ceil(-Math.log10(step)));
  for (let lon = Math.ceil(west / step) * step; lon < east; lon += step) {
    const [x] = view.toScreen(0, lon);
    c.moveTo(x, 0);
    c.lineTo(x, view.height);
    c.fillText(`${lon.toFixed(digits)}°`, x + 3, view.height - 5);
  }
  for (let lat = Math.ceil(south / step) * step; lat < north; lat += step) {
    const [, y] = view.toScreen(lat, 0);
    c.moveTo(0, y);
    c.lineTo(view.width, y);
    c.fillText(`${lat.toFixed(digits)}°`, 4, y - 3);
  }
  c.stroke();
}

function zones(c, view, found, colours) {
  for (const zone of found) {
    const area = new Path2D();
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (const ring of zone.rings) {
      ring.forEach(([lon, lat], i) => {
        const [x, y] = view.toScreen(lat, lon);
        area[i ? "lineTo" : "moveTo"](x, y);
        [box[0], box[1], box[2], box[3]] = [Math.min(box[0], x), Math.min(box[1], y), Math.max(box[2], x), Math.max(box[3], y)];
      });
      area.closePath();
    }
    if (zone.closed) {
      c.fillStyle = colours["zone-fill"];
      c.fill(area, "evenodd");
      c.save();
      c.clip(area, "evenodd");
      hatch(c, view, box, colours);
      c.restore();
    }
    c.setLineDash(zone.closed ? [] : [6, 4]);
    c.strokeStyle = colours.zone;
    c.lineWidth = 1.4;
    c.stroke(area);
    c.setLineDash([]);
  }
}

function hatch(c, view, box, colours) {
  const [left, top, right, bottom] = [Math.max(0, box[0]), Math.max(0, box[1]), Math.min(view.width, box[2]), Math.min(view.height, box[3])];
  if (right <= left || bottom <= top) return;
  c.beginPath();
  for (let x = left - (bottom - top); x < right; x += 9) {
    c.moveTo(x, bottom);
    c.lineTo(x + bottom - top, top);
  }
  c.strokeStyle = colours.zone;
  c.globalAlpha = 0.3;
  c.lineWidth = 1;
  c.stroke();
  c.globalAlpha = 1;
}

function segments(c, view, region, state, colours) {
  const places = region.stations.map((one) => view.toScreen(one.lat, one.lon));
  const shut = new Set(state.avoid);
  c.strokeStyle = colours.segment;
  c.lineWidth = 0.8;
  c.beginPath();
  for (const [a, b] of region.segments) {
    c.moveTo(...places[a]);
    c.lineTo(...places[b]);
  }
  c.stroke();
  c.strokeStyle = colours.warn;
  c.lineWidth = 2;
  c.setLineDash([3, 5]);
  c.beginPath();
  for (const [a, b] of region.segments) {
    const [one, other] = [region.stations[a].id, region.stations[b].id];
    if (!shut.has(`${one}:${other}`) && !shut.has(`${other}:${one}`)) continue;
    c.moveTo(...places[a]);
    c.lineTo(...places[b]);
  }
  c.stroke();
  c.setLineDash([]);
}

function wind(c, view, state, colours) {
  const hour = state.wind.hours[Math.min(state.hour, state.wind.hours.length - 1)];
  if (!hour) return;
  const tips = [];
  c.strokeStyle = colours.wind;
  c.lineWidth = 1.3;
  c.beginPath();
  state.wind.points.forEach(([lat, lon], i) => {
    const [x, y] = view.toScreen(lat, lon);
    if (x < -40 || y < -40 || x > view.width + 40 || y > view.height + 40) return;
    const [east, north] = [hour.east[i], hour.north[i]];
    const speed = Math.hypot(east, north);
    if (speed < 0.2) return;
    const length = 6 + MPS_PX * speed;
    const [dx, dy] = [(east / speed) * length, (-north / speed) * length];
    const [hx, hy] = [x + dx / 2, y + dy / 2];
    c.moveTo(x - dx / 2, y - dy / 2);
    c.lineTo(hx, hy);
    for (const turn of [2.6, -2.6]) {
      const angle = Math.atan2(dy, dx) + turn;
      c.moveTo(hx, hy);
      c.lineTo(hx + 5 * Math.cos(angle), hy + 5 * Math.sin(angle));
    }
    if (hour.spread?.[i] > 0) tips.push([hx, hy, MPS_PX * hour.spread[i]]);
  });
  c.stroke();
  c.fillStyle = colours.wind;
  c.globalAlpha = 0.16;
  c.beginPath();
  for (const [x, y, radius] of tips) {
    c.moveTo(x + radius, y);
    c.arc(x, y, radius, 0, 2 * Math.PI);
  }
  c.fill();
  c.globalAlpha = 1;
}

function path(c, view, points, colour, width, dash) {
  if (!points?.length) return;
  c.beginPath();
  points.forEach(([lat, lon], i) => c[i ? "lineTo" : "moveTo"](...view.toScreen(lat, lon)));
  c.setLineDash(dash);
  c.strokeStyle = colour;
  c.lineWidth = width;
  c.stroke();
  c.setLineDash([]);
}

function route(c, view, plan, colour, width, dash) {
  for (const leg of plan.path) path(c, view, leg, colour, width, dash);
}

function chosen(c, view, plan, colours) {
  route(c, view, plan, colours.halo, 7, []);
  route(c, view, plan, colours.route, 3.5, []);
  c.font = "600 11px system-ui, sans-serif";
  c.textAlign = "center";
  c.textBaseline = "middle";
  plan.path.forEach((leg, number) => {
    const [a, b] = [leg[Math.floor((leg.length - 1) / 2)], leg[Math.floor((leg.length - 1) / 2) + 1] || leg.at(-1)];
    const [x, y] = view.toScreen((a[0] + b[0]) / 2, (a[1] + b[1]) / 2);
    disc(c, x, y, 9, colours.route, colours.halo);
    c.fillStyle = colours.paper;
    c.fillText(String(number + 1), x, y + 0.5);
  });
  c.textAlign = "start";
  c.textBaseline = "alphabetic";
}

function disc(c, x, y, radius, fill, rim) {
  c.beginPath();
  c.arc(x, y, radius, 0, 2 * Math.PI);
  c.fillStyle = fill;
  c.fill();
  c.strokeStyle = rim;
  c.lineWidth = 1.5;
  c.stroke();
}

// Each station is a ring; the share that is filled is the chance of a free pad in the hour shown.
function stations(c, view, state, colours, map, taken) {
  const plan = state.plans[state.chosen];
  const onRoute = new Set(plan?.route || []);
  const stops = new Set(plan?.stops || []);
  const reached = new Set((state.reach || []).map((one) => one.station));
  const later = [];
  state.region.stations.forEach((one, number) => {
    if (one.bend) return;
    const [x, y] = view.toScreen(one.lat, one.lon);
    if (x < -20 || y < -20 || x > view.width + 20 || y > view.height + 20) return;
    const radius = stops.has(one.id) ? 8 : onRoute.has(one.id) ? 6.5 : 5;
    const queue = state.queues?.stations?.[one.id];
    const free = queue ? queue.p_free[Math.min(state.hour, queue.p_free.length - 1)] : one.pads ? 1 : 0;
    disc(c, x, y, radius, colours.paper, colours.station);
    if (one.pads && free > 0) {
      c.beginPath();
      c.moveTo(x, y);
      c.arc(x, y, radius - 1, -Math.PI / 2, -Math.PI / 2 + 2 * Math.PI * free);
      c.closePath();
      c.fillStyle = colours.station;
      c.fill();
    }
    if (state.avoid.includes(one.id)) cross(c, x, y, radius + 3, colours.warn);
    if (state.stopAt.includes(one.id)) square(c, x, y, radius + 4, colours.route);
    if (number === map.selected) square(c, x, y, radius + 7, colours.ink);
    later.push([onRoute.has(one.id) ? 0 : 1, number, x, y, reached.has(one.id) ? 14 : radius]);
  });
  c.font = "12px system-ui, sans-serif";
  later.sort((a, b) => a[0] - b[0]);
  for (const [order, number, x, y, radius] of later) label(c, view, state.region.stations[number].id, x, radius + 4, y + 4, colours, taken, order === 0);
}

// The name of a place, to its right; to its left where the map ends.
function label(c, view, words, at, gap, y, colours, taken, bold) {
  const wide = c.measureText(words).width + 4;
  const x = at < view.width && at + gap + wide > view.width ? at - gap - wide : at + gap;
  const box = [x - 2, y - 11, x + wide, y + 4];
  if (taken.length > 400 || taken.some((t) => box[0] < t[2] && box[2] > t[0] && box[1] < t[3] && box[3] > t[1])) return;
  taken.push(box);
  c.font = `${bold ? 600 : 400} 12px system-ui, sans-serif`;
  c.strokeStyle = colours.halo;
  c.lineWidth = 3;
  c.strokeText(words, x, y);
  c.fillStyle = bold ? colours.ink : colours.faint;
  c.fillText(words, x, y);
}

// Names of the base map, where those of the network leave room.
function places(c, view, names, colours, taken) {
  c.textAlign = "center";
  for (const { name, place, rank, water } of [...names].sort((a, b) => a.rank - b.rank)) {
    const [x, y] = view.place(place);
    if (x < 0 || y < 0 || x > view.width || y > view.height) continue;
    c.font = `${water ? "italic " : ""}${rank < 3 ? 600 : 400} ${rank < 3 ? 13 : 11.5}px system-ui, sans-serif`;
    const half = c.measureText(name).width / 2 + 6;
    const box = [x - half, y - 12, x + half, y + 8];
    if (taken.length > 400 || taken.some((t) => box[0] < t[2] && box[2] > t[0] && box[1] < t[3] && box[3] > t[1])) continue;
    taken.push(box);
    c.strokeStyle = colours.halo;
    c.lineWidth = 3;
    c.strokeText(name, x, y + 4);
    c.fillStyle = water ? colours.wind : colours.faint;
    c.fillText(name, x, y + 4);
  }
  c.textAlign = "start";
}

function cross(c, x, y, r, colour) {
  c.beginPath();
  c.moveTo(x - r, y - r);
  c.lineTo(x + r, y + r);
  c.moveTo(x + r, y - r);
  c.lineTo(x - r, y + r);
  c.strokeStyle = colour;
  c.lineWidth = 2.5;
  c.stroke();
}

function square(c, x, y, r, colour) {
  c.strokeStyle = colour;
  c.lineWidth = 2;
  c.strokeRect(x - r, y - r, 2 * r, 2 * r);
}

function ends(c, view, state, colours) {
  for (const [place, letter, colour] of [
    [state.start, "A", colours.start],
    [state.target, "B", colours.target],
  ]) {
    if (!place) continue;
    const [x, y] = view.toScreen(place.lat, place.lon);
    c.beginPath();
    c.moveTo(x, y);
    c.bezierCurveTo(x - 16, y - 18, x - 11, y - 32, x, y - 32);
    c.bezierCurveTo(x + 11, y - 32, x + 16, y - 18, x, y);
    c.fillStyle = colour;
    c.fill();
    c.strokeStyle = colours.halo;
    c.lineWidth = 1.5;
    c.stroke();
    c.fillStyle = colours.paper;
    c.font = "700 12px system-ui, sans-serif";
    c.textAlign = "center";
    c.fillText(letter, x, y - 15);
    c.textAlign = "start";
  }
}

function vehicles(c, view, found, colours, taken) {
  for (const one of found) {
    const [x, y] = view.toScreen(one.lat, one.lon);
    if (x < -20 || y < -20 || x > view.width + 20 || y > view.height + 20) continue;
    const angle = ((one.heading_deg ?? 0) * Math.PI) / 180;
    c.save();
    c.translate(x, y);
    c.rotate(angle);
    c.beginPath();
    c.moveTo(0, -10);
    c.lineTo(7, 8);
    c.lineTo(0, 4);
    c.lineTo(-7, 8);
    c.closePath();
    c.fillStyle = one.stale ? colours.faint : colours.vehicle;
    c.fill();
    c.strokeStyle = colours.halo;
    c.lineWidth = 1.5;
    c.stroke();
    c.restore();
    if (found.length <= 60 && one.name) {
      c.font = "12px system-ui, sans-serif";
      label(c, view, one.name, x, 11, y + 4, colours, taken, true);
    }
  }
}

function marks(c, view, found, colours) {
  c.font = "700 12px system-ui, sans-serif";
  c.textAlign = "center";
  for (const { place, label: words, colour, name } of found) {
    const [x, y] = view.toScreen(...place);
    disc(c, x, y, 9, colours[colour] || colours.ink, colours.halo);
    c.fillStyle = colours.paper;
    c.fillText(words, x, y + 4);
    if (!name) continue;
    c.textAlign = "start";
    c.strokeStyle = colours.halo;
    c.lineWidth = 3;
    c.strokeText(name, x + 13, y + 4);
    c.fillStyle = colours.ink;
    c.fillText(name, x + 13, y + 4);
    c.textAlign = "center";
  }
  c.textAlign = "start";
}

// Stations where a drone could land instead: how long that takes, and with which charge; a dashed ring where that is below the reserve.
function reach(c, view, state, colours, taken) {
  if (!state.reach?.length || !region_(state)) return;
  const places = region_(state);
  for (const { station, minutes, soc, risk } of state.reach) {
    const place = places.get(station);
    if (!place) continue;
    const [x, y] = view.toScreen(place.lat, place.lon);
    c.beginPath();
    c.arc(x, y, 12, 0, 2 * Math.PI);
    c.setLineDash(risk > 0.01 ? [3, 3] : []);
    c.strokeStyle = risk > 0.01 ? colours.warn : colours.start;
    c.lineWidth = 2.5;
    c.stroke();
    c.setLineDash([]);
    c.font = "600 12px system-ui, sans-serif";
    label(c, view, `${minutes} min, ${Math.round(100 * soc)} %`, x, 18, y + 20, colours, taken, true);
  }
}

function region_(state) {
  if (!state.region) return null;
  state.region.byId ||= new Map(state.region.stations.map((one) => [one.id, one]));
  return state.region.byId;
}

function ghost(c, view, state, dragged, colours) {
  const from = state.region?.stations[dragged.station];
  path(c, view, [dragged.place || [from.lat, from.lon], view.toWorld(dragged.x, dragged.y)], colours.route, 2, [4, 4]);
  disc(c, dragged.x, dragged.y, 8, colours.paper, colours.route);
}

// Where the next key acts, for those who see it: around a drone or a mark, else the middle of the map. Stations have a frame of their own.
function aim(c, map, colours) {
  if (map.carried || map.selected >= 0) return;
  const [x, y] = map.keys.place();
  if (map.keys.aim) return void square(c, x, y, 16, colours.ink);
  c.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    c.moveTo(x + 4 * dx, y + 4 * dy);
    c.lineTo(x + 12 * dx, y + 12 * dy);
  }
  c.strokeStyle = colours.ink;
  c.lineWidth = 2;
  c.stroke();
}

function scaleBar(c, view, colours, feet) {
  const most = view.metresPerPixel() * 110;
  const unit = feet && most < 1000 ? 0.3048 : 1;
  const power = 10 ** Math.floor(Math.log10(most / unit));
  const nice = [5, 2, 1].find((m) => m * power * unit <= most) * power;
  const wide = (nice * unit) / view.metresPerPixel();
  const [x, y] = [view.width - wide - 14, view.height - 14];
  c.strokeStyle = colours.ink;
  c.lineWidth = 2;
  c.beginPath();
  c.moveTo(x, y - 5);
  c.lineTo(x, y);
  c.lineTo(x + wide, y);
  c.lineTo(x + wide, y - 5);
  c.stroke();
  c.fillStyle = colours.ink;
  c.font = "11px system-ui, sans-serif";
  c.textAlign = "center";
  c.fillText(unit !== 1 ? `${nice} ft` : nice >= 1000 ? `${nice / 1000} km` : `${nice} m`, x + wide / 2, y - 6);
  c.textAlign = "start";
}
