// A base map of pictures, where the operator gives one: tiles of the page's own server, the newest kept.
const SIZE = 256;
const KEPT = 400;

export class Tiles {
  constructor(changed) {
    this.changed = changed;
    this.known = new Map();
  }

  tile(zoom, column, row) {
    const key = `${zoom}/${column}/${row}`;
    let found = this.known.get(key);
    if (!found) {
      found = new Image();
      found.onload = () => this.changed();
      found.src = `/api/tile?z=${zoom}&x=${column}&y=${row}`;
      if (this.known.size >= KEPT) this.known.delete(this.known.keys().next().value);
      this.known.set(key, found);
    }
    return found.complete && found.naturalWidth ? found : null;
  }

  draw(c, view, base) {
    const zoom = Math.max(base.low, Math.min(base.high, Math.round(view.zoom)));
    const count = 2 ** zoom;
    const size = (SIZE * view.scale) / count;
    if (size > 8 * SIZE || size < SIZE / 4) return;
    const [left, top] = view.place([0, 0]);
    const [first, last] = [Math.max(0, Math.floor(-left / size)), Math.min(count - 1, Math.floor((view.width - left) / size))];
    const [upper, lower] = [Math.max(0, Math.floor(-top / size)), Math.min(count - 1, Math.floor((view.height - top) / size))];
    for (let column = first; column <= last; column++) {
      for (let row = upper; row <= lower; row++) {
        const image = this.tile(zoom, column, row);
        if (image) c.drawImage(image, left + column * size, top + row * size, size + 0.5, size + 0.5);
      }
    }
    if (base.attribution) {
      c.font = "10px system-ui, sans-serif";
      c.fillStyle = "#444";
      c.fillText(base.attribution.replace(/<[^>]*>/g, "").slice(0, 120), 6, 12);
    }
  }
}
