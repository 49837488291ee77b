// Which part of the world is shown: Web Mercator, zoom as a power of two, no tiles needed.

const EARTH = 256; // pixels of the world at zoom 0

export function mercator(lat, lon) {
  const sine = Math.sin((Math.max(-85.05, Math.min(85.05, lat)) * Math.PI) / 180);
  return [(lon / 360 + 0.5) * EARTH, (0.5 - Math.log((1 + sine) / (1 - sine)) / (4 * Math.PI)) * EARTH];
}

export function geographic(x, y) {
  const n = Math.PI - (2 * Math.PI * y) / EARTH;
  return [(Math.atan(Math.sinh(n)) * 180) / Math.PI, (x / EARTH - 0.5) * 360];
}

export class View {
  constructor() {
    this.width = 1;
    this.height = 1;
    this.zoom = 2;
    [this.cx, this.cy] = mercator(0, 0);
  }

  get scale() {
    return 2 ** this.zoom;
  }

  toScreen(lat, lon) {
    const [x, y] = mercator(lat, lon);
    return [(x - this.cx) * this.scale + this.width / 2, (y - this.cy) * this.scale + this.height / 2];
  }

  // The same for points that were projected before: [x, y] of `mercator`.
  place(point) {
    return [(point[0] - this.cx) * this.scale + this.width / 2, (point[1] - this.cy) * this.scale + this.height / 2];
  }

  toWorld(x, y) {
    return geographic((x - this.width / 2) / this.scale + this.cx, (y - this.height / 2) / this.scale + this.cy);
  }

  pan(dx, dy) {
    this.cx -= dx / this.scale;
    this.cy = Math.max(0, Math.min(EARTH, this.cy - dy / this.scale));
  }

  // Zoom so that what is at (x, y) stays there.
  zoomAt(x, y, by) {
    const before = this.scale;
    this.zoom = Math.max(1, Math.min(20, this.zoom + by));
    const change = 1 / before - 1 / this.scale;
    this.cx += (x - this.width / 2) * change;
    this.cy += (y - this.height / 2) * change;
  }

  centre(lat, lon) {
    [this.cx, this.cy] = mercator(lat, lon);
    this.zoom = Math.max(this.zoom, 13);
  }

  // Show [west, south, east, north], degrees, with a margin in pixels.
  fit([west, south, east, north], margin = 48) {
    const [x1, y1] = mercator(north, west);
    const [x2, y2] = mercator(south, east);
    this.cx = (x1 + x2) / 2;
    this.cy = (y1 + y2) / 2;
    const across = Math.max(40, this.width - 2 * margin) / Math.max(x2 - x1, 1e-9);
    const down = Math.max(40, this.height - 2 * margin) / Math.max(y2 - y1, 1e-9);
    this.zoom = Math.max(1, Math.min(17, Math.log2(Math.min(across, down))));
  }

  metresPerPixel() {
    const [lat] = geographic(this.cx, this.cy);
    return (40075016.7 * Math.cos((lat * Math.PI) / 180)) / (EARTH * this.scale);
  }
}
