// The map by keys alone: stations, segments, vehicles and marks one after another, their menus, and what is carried to another place.
const STEP = 12; // pixels by which an arrow moves what is carried
const EDGE = 30; // pixels from the edge within which the map follows

export class Keys {
  constructor(map) {
    this.map = map;
    this.segment = -1;
    this.aim = null; // a vehicle or a mark; a station is `map.selected`
  }

  // What a key does; false where it does nothing here.
  press(e) {
    const { map } = this;
    const arrow = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
    if (arrow && map.carried?.mark) this.shift(arrow, e.shiftKey ? 1 : STEP);
    else if (arrow) this.pan(80 * arrow[0], 80 * arrow[1]);
    else if (e.key === "+" || e.key === "=") this.zoom(0.5);
    else if (e.key === "-") this.zoom(-0.5);
    else if (e.key === "0") map.fit();
    else if (e.key === "n" || e.key === "p") this.station(e.key === "n" ? 1 : -1);
    else if (e.key === "s") this.nextSegment();
    else if (e.key === "v" || e.key === "m") this.next(e.key);
    else if (e.key === "Enter") this.enter();
    else if (e.key === "Escape") this.forget();
    else return false;
    map.changed();
    return true;
  }

  pan(dx, dy) {
    this.map.view.pan(dx, dy);
    this.map.fitted = false;
    this.follow();
  }

  zoom(by) {
    const { width, height } = this.map.view;
    this.map.view.zoomAt(width / 2, height / 2, by);
    this.map.fitted = false;
    this.follow();
  }

  say(words) {
    this.map.live.textContent = words;
  }

  // Bring a place into view.
  seek(lat, lon) {
    const [x, y] = this.map.view.toScreen(lat, lon);
    const { width, height } = this.map.view;
    if (x < EDGE || y < EDGE || x > width - EDGE || y > height - EDGE) this.map.view.pan(width / 2 - x, height / 2 - y);
  }

  station(by) {
    const { map } = this;
    const stations = map.state.region?.stations || [];
    if (!stations.some((one) => !one.bend)) return;
    do map.selected = (map.selected + by + stations.length) % stations.length;
    while (stations[map.selected].bend);
    this.aim = null;
    this.seek(stations[map.selected].lat, stations[map.selected].lon);
    this.follow();
    this.say(map.describe(map.selected));
  }

  // The next vehicle (v), or the next mark that can be moved (m).
  next(key) {
    const { state } = this.map;
    const all = key === "v" ? state.vehicles.map(({ id, name, lat, lon }) => ({ key, id, name, lat, lon })) : (state.movable ? state.marks || [] : []).filter((one) => one.id).map(({ id, name, place }) => ({ key, id, name, lat: place[0], lon: place[1] }));
    if (!all.length) return this.say(key === "v" ? "no drone on the map" : "nothing that can be moved");
    const at = this.aim?.key === key ? all.findIndex((one) => one.id === this.aim.id) : -1;
    this.aim = all[(at + 1) % all.length];
    this.map.selected = -1;
    this.seek(this.aim.lat, this.aim.lon);
    return this.say(this.aim.name || String(this.aim.id));
  }

  // The menu of the next segment of the plan, at its middle.
  nextSegment() {
    const { map } = this;
    const places = Object.fromEntries((map.state.region?.stations || []).map((one) => [one.id, one]));
    const route = (map.state.plans[map.state.chosen]?.route || []).map((id) => places[id]);
    const found = route.slice(1).map((b, i) => [route[i], b]).filter(([a, b]) => a && b && !a.bend && !b.bend);
    if (!found.length) return;
    this.segment = (this.segment + 1) % found.length;
    const [a, b] = found[this.segment];
    this.seek((a.lat + b.lat) / 2, (a.lon + b.lon) / 2);
    const [ax, ay] = map.view.toScreen(a.lat, a.lon);
    const [bx, by] = map.view.toScreen(b.lat, b.lon);
    map.pick((ax + bx) / 2, (ay + by) / 2, -1);
    map.menu.focus();
  }

  // Where what is selected is on the screen; the middle of the map where nothing is.
  place() {
    const { map } = this;
    const one = map.state.region?.stations[map.selected] || this.moved();
    return one ? map.view.toScreen(one.lat, one.lon) : [map.view.width / 2, map.view.height / 2];
  }

  // The vehicle or mark that is selected, as it is now.
  moved() {
    if (!this.aim) return null;
    const { state } = this.map;
    if (this.aim.key === "v") return state.vehicles.find((one) => one.id === this.aim.id) || null;
    const mark = (state.marks || []).find((one) => one.id === this.aim.id);
    return mark ? { lat: mark.place[0], lon: mark.place[1] } : null;
  }

  enter() {
    const { map } = this;
    if (map.carried) {
      const { x, y } = map.carried;
      const station = map.carried.mark || map.selected < 0 ? -1 : map.selected;
      return map.putDown(x, y, station);
    }
    if (this.aim?.key === "v") return map.emit("vehicle", { id: this.aim.id });
    const [x, y] = this.place();
    map.pick(x, y, map.selected < 0 ? map.stationAt(x, y) : map.selected);
    return map.menu.focus();
  }

  forget() {
    this.map.menu.close();
    if (this.map.carried) this.say("It stays where it was.");
    this.map.carried = null;
    this.map.selected = -1;
    this.aim = null;
  }

  // Take up a stop or a mark; it is put down by Enter, or by a click.
  carry({ station, mark }) {
    const { map } = this;
    if (mark) {
      const found = map.state.marks.find((one) => one.id === mark);
      const [x, y] = map.view.toScreen(...found.place);
      map.carried = { mark, place: found.place, x, y };
      this.say(`${mark} is moved: arrow keys move it, with Shift a little; Enter puts it there, Escape leaves it`);
    } else {
      const number = map.state.region.stations.findIndex((one) => one.id === station);
      map.carried = { from: station, station: number };
      map.selected = number;
      this.follow();
      this.say(`${station} is moved: n and p choose another station, Enter stops there instead, Escape leaves it`);
    }
    map.canvas.focus();
    map.changed();
  }

  shift([dx, dy], by) {
    const { carried, view } = this.map;
    carried.x = Math.max(0, Math.min(view.width, carried.x - dx * by));
    carried.y = Math.max(0, Math.min(view.height, carried.y - dy * by));
  }

  // A stop that is carried is drawn at the station that is selected.
  follow() {
    const { map } = this;
    if (map.carried?.from) [map.carried.x, map.carried.y] = this.place();
  }
}
