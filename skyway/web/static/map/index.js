// The operator's map: one canvas, drawn when something has changed. It knows nothing of the page around it.
import { draw, palette } from "skyway-map/draw.js";
import { Keys } from "skyway-map/keys.js";
import { Menu } from "skyway-map/menu.js";
import { Tiles } from "skyway-map/tiles.js";
import { View } from "skyway-map/view.js";

const NEAR = 14; // pixels within which a station is meant
const DRAGGED = 6; // pixels from which a press is a drag

export class SkywayMap {
  constructor(root, label, emit) {
    this.emit = emit;
    this.view = new View();
    this.tiles = new Tiles(() => this.changed());
    this.state = { plans: [], chosen: 0, hour: 0, avoid: [], stopAt: [], vehicles: [], tracks: [], layers: {} };
    this.selected = -1;
    this.pointers = new Map();
    this.canvas = document.createElement("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "application");
    this.canvas.setAttribute("aria-label", `${label}. Arrow keys move it, plus and minus zoom, 0 shows everything; more keys stand under Key.`);
    this.tip = document.createElement("div");
    this.tip.className = "map-tip";
    this.tip.hidden = true;
    this.live = document.createElement("div");
    this.live.className = "only-heard";
    this.live.setAttribute("aria-live", "polite");
    root.append(this.canvas, this.tip, this.live);
    this.context = this.canvas.getContext("2d");
    this.keys = new Keys(this);
    this.menu = new Menu(root, (action, target) => (action === "carry" ? this.keys.carry(target) : this.emit("choose", { action, ...target })));
    this.colours = palette(root);
    this.feet = /(?:^|; )skyway_height=ft/.test(document.cookie);
    this.listen(root);
  }

  listen(root) {
    this.sized = new ResizeObserver(() => this.resize(root));
    this.sized.observe(root);
    const on = (name, act, options) => this.canvas.addEventListener(name, act, options);
    on("pointerdown", (e) => this.press(e));
    on("pointermove", (e) => this.move(e));
    on("pointerup", (e) => this.release(e));
    on("pointercancel", (e) => this.pointers.delete(e.pointerId));
    on("pointerleave", () => (this.tip.hidden = true));
    on("wheel", (e) => this.wheel(e), { passive: false });
    on("dblclick", (e) => this.zoom(this.x(e), this.y(e), e.shiftKey ? -1 : 1));
    on("keydown", (e) => !e.ctrlKey && !e.metaKey && !e.altKey && this.keys.press(e) && e.preventDefault());
    on("focus", () => this.changed());
    on("blur", () => this.changed());
    this.themed = () => {
      this.colours = palette(root);
      if (this.state.base?.kind === "vectors") this.tiles.forget();
      this.changed();
    };
    this.watch = new MutationObserver(this.themed);
    this.watch.observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme"] });
  }

  destroy() {
    this.gone = true;
    this.sized.disconnect();
    this.watch.disconnect();
    cancelAnimationFrame(this.frame);
  }

  // Take new data: region, wind, queues, plans, chosen, hour, start, target, avoid, stopAt, vehicles, tracks, layers.
  set(parts) {
    Object.assign(this.state, parts);
    if (parts.region || parts.fitted) this.fit();
    if (parts.centre) {
      this.view.centre(...parts.centre);
      this.fitted = false;
    }
    this.changed();
  }

  async load(name, url) {
    const answer = await fetch(url, { headers: { Accept: "application/json" } });
    if (answer.ok && !this.gone) this.set({ [name]: await answer.json() });
  }

  fit() {
    const box = this.state.bounds || this.state.region?.bounds;
    if (box) this.view.fit(box);
    this.fitted = true; // until somebody moves it
    this.changed();
  }

  changed() {
    if (this.frame || this.gone) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      draw(this.context, this.view, this.state, this.colours, this);
    });
  }

  resize(root) {
    const first = this.view.width < 2;
    const ratio = (window.devicePixelRatio || 1) * (root.currentCSSZoom || 1);
    const { clientWidth, clientHeight } = root;
    if (!clientWidth || !clientHeight) return;
    this.view.width = clientWidth;
    this.view.height = clientHeight;
    this.canvas.width = Math.round(clientWidth * ratio);
    this.canvas.height = Math.round(clientHeight * ratio);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (first || this.fitted) this.fit();
    this.changed();
  }

  // Where a pointer is on the map, also where the page is drawn larger.
  x(e) {
    const box = this.canvas.getBoundingClientRect();
    return ((e.clientX - box.left) * this.view.width) / box.width;
  }

  y(e) {
    const box = this.canvas.getBoundingClientRect();
    return ((e.clientY - box.top) * this.view.height) / box.height;
  }

  stationAt(x, y) {
    let best = -1;
    let least = NEAR;
    (this.state.region?.stations || []).forEach((one, number) => {
      if (one.bend) return;
      const [sx, sy] = this.view.toScreen(one.lat, one.lon);
      const away = Math.hypot(sx - x, sy - y);
      if (away < least) [best, least] = [number, away];
    });
    return best;
  }

  stops() {
    return this.state.plans[this.state.chosen]?.stops || [];
  }

  // A mark with an id is moved by dragging it, where the page takes that.
  markAt(x, y) {
    if (!this.state.movable) return null;
    return (this.state.marks || []).findLast(({ id, place }) => {
      const [mx, my] = this.view.toScreen(...place);
      return id && Math.hypot(mx - x, my - y) < NEAR;
    });
  }

  press(e) {
    this.canvas.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, { x: this.x(e), y: this.y(e), fromX: this.x(e), fromY: this.y(e) });
    this.menu.close();
    const station = this.stationAt(this.x(e), this.y(e));
    const id = station < 0 ? null : this.state.region.stations[station].id;
    const mark = this.markAt(this.x(e), this.y(e));
    this.dragged = null;
    if (this.pointers.size === 1 && mark) this.dragged = { mark: mark.id, place: mark.place };
    else if (this.pointers.size === 1 && id && this.stops().includes(id)) this.dragged = { from: id, station };
  }

  move(e) {
    const known = this.pointers.get(e.pointerId);
    if (!known) {
      if (this.carried) this.carried = { ...this.carried, x: this.x(e), y: this.y(e) };
      if (this.carried) this.changed();
      return this.hover(this.x(e), this.y(e));
    }
    const others = [...this.pointers.entries()].filter(([id]) => id !== e.pointerId);
    if (others.length) this.pinch(known, e, others[0][1]);
    else if (this.dragged) this.dragged = { ...this.dragged, x: this.x(e), y: this.y(e) };
    else this.view.pan(this.x(e) - known.x, this.y(e) - known.y);
    known.x = this.x(e);
    known.y = this.y(e);
    if (!this.dragged) this.fitted = false;
    this.changed();
  }

  pinch(known, e, other) {
    const before = Math.hypot(known.x - other.x, known.y - other.y);
    const after = Math.hypot(this.x(e) - other.x, this.y(e) - other.y);
    if (before > 1 && after > 1) {
      this.view.zoomAt((this.x(e) + other.x) / 2, (this.y(e) + other.y) / 2, Math.log2(after / before));
    }
  }

  release(e) {
    const known = this.pointers.get(e.pointerId);
    this.pointers.delete(e.pointerId);
    if (!known || this.pointers.size) return;
    const far = Math.hypot(this.x(e) - known.fromX, this.y(e) - known.fromY);
    const station = this.stationAt(this.x(e), this.y(e));
    const { dragged } = this;
    this.dragged = null;
    this.changed();
    if (dragged && far >= DRAGGED) this.drop(dragged, this.x(e), this.y(e), station);
    else if (far < DRAGGED && this.carried) this.putDown(this.x(e), this.y(e), station);
    else if (far < DRAGGED) {
      const vehicle = this.vehicleAt(this.x(e), this.y(e));
      if (vehicle) this.emit("vehicle", { id: vehicle.id });
      else this.pick(this.x(e), this.y(e), station);
    }
  }

  // A mark is anywhere, a stop at a station.
  drop(moved, x, y, station) {
    if (moved.mark) {
      const [lat, lon] = this.view.toWorld(x, y);
      this.emit("drag_mark", { id: moved.mark, lat, lon });
    } else if (station >= 0 && station !== moved.station) {
      this.emit("drag_stop", { from: moved.from, to: this.state.region.stations[station].id });
    }
  }

  putDown(x, y, station) {
    const { carried } = this;
    this.carried = null;
    this.drop(carried, x, y, station);
    this.changed();
  }

  // Somebody wants to do something at a station or a place.
  pick(x, y, station) {
    this.selected = station;
    const [lat, lon] = this.view.toWorld(x, y);
    const place = station < 0 ? null : this.state.region.stations[station];
    const mark = this.markAt(x, y);
    const segment = place ? null : this.segmentAt(x, y);
    const target = { station: place?.id || null, segment, mark: mark?.id || null, lat: place?.lat ?? lat, lon: place?.lon ?? lon };
    if (this.state.actions) this.menu.open(x, y, mark?.id || place?.name || segment, this.actionsFor(place, segment, mark), target);
    else this.emit("choose", { action: "pick", ...target });
    this.changed();
  }

  // A segment of the plan that is shown, as FROM:TO.
  segmentAt(x, y) {
    const route = this.state.plans[this.state.chosen]?.route || [];
    const places = Object.fromEntries((this.state.region?.stations || []).map((one) => [one.id, one]));
    for (let i = 0; i + 1 < route.length; i++) {
      const [a, b] = [places[route[i]], places[route[i + 1]]];
      if (!a || !b || a.bend || b.bend) continue;
      const [ax, ay] = this.view.toScreen(a.lat, a.lon);
      const [bx, by] = this.view.toScreen(b.lat, b.lon);
      const along = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / Math.max((bx - ax) ** 2 + (by - ay) ** 2, 1);
      if (along > 0 && along < 1 && Math.hypot(ax + along * (bx - ax) - x, ay + along * (by - ay) - y) < NEAR) return `${a.id}:${b.id}`;
    }
    return null;
  }

  actionsFor(place, segment, mark) {
    return this.state.actions.filter((one) => {
      if (one.mark) return Boolean(mark);
      if (one.stop) return Boolean(place) && this.stops().includes(place.id);
      if (one.segment) return Boolean(segment);
      if (!place) return !one.station;
      if (one.listed) return (this.state[one.listed] || []).includes(place.id);
      if (one.unlisted) return !(this.state[one.unlisted] || []).includes(place.id);
      return true;
    });
  }

  vehicleAt(x, y) {
    return this.state.vehicles.find((one) => {
      const [vx, vy] = this.view.toScreen(one.lat, one.lon);
      return Math.hypot(vx - x, vy - y) < NEAR;
    });
  }

  hover(x, y) {
    const station = this.stationAt(x, y);
    this.canvas.style.cursor = station >= 0 ? "pointer" : "";
    const words = station >= 0 ? this.describe(station) : this.zoneWords(x, y);
    this.tip.hidden = !words;
    if (!words) return;
    this.tip.textContent = words;
    this.tip.style.left = `${Math.min(x + 14, this.view.width - 240)}px`;
    this.tip.style.top = `${Math.min(y + 14, this.view.height - 60)}px`;
  }

  describe(number) {
    const one = this.state.region.stations[number];
    const queue = this.state.queues?.stations?.[one.id];
    const hour = Math.min(this.state.hour, (queue?.wait_s.length || 1) - 1);
    const pads = one.pads ? `${one.pads} pads` : "no pads";
    if (!queue) return `${one.id}: ${one.name}\n${pads}`;
    const wait = `expected wait ${Math.round(queue.wait_s[hour] / 60)} min, a pad is free ${Math.round(100 * queue.p_free[hour])} %`;
    return `${one.id}: ${one.name}\n${pads}, ${wait}`;
  }

  zoneWords(x, y) {
    const [lat, lon] = this.view.toWorld(x, y);
    const zone = (this.state.region?.zones || []).find((one) => one.rings.some((ring) => inside(ring, lon, lat)));
    return zone ? `${zone.name}\n${zone.kind}, ${zone.limits}, ${zone.when}` : "";
  }

  wheel(e) {
    e.preventDefault();
    this.zoom(this.x(e), this.y(e), Math.max(-1, Math.min(1, -e.deltaY / (e.deltaMode ? 6 : 240))));
  }

  zoom(x, y, by) {
    this.view.zoomAt(x, y, by);
    this.fitted = false;
    this.menu.close();
    this.changed();
  }
}

function inside(ring, x, y) {
  let found = false;
  for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
    const [xi, yi] = ring[i];
    const [xj, yj] = ring[j];
    if (yi > y !== yj > y && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) found = !found;
  }
  return found;
}
