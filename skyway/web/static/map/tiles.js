// A base map, where the operator gives one: tiles of the page's own server, or of the one that he names; the newest are kept.
import { drawn } from "skyway-map/vectors.js";

const KEPT = { pictures: 400, vectors: 96 };
const SIZE = { pictures: 256, vectors: 512 }; // pixels of a tile at its own zoom
const MAX_BYTES = 8 * 2 ** 20;
const COARSER = 5;
const AGAIN_MS = 15000;
const REFERRER = "origin"; // tile servers want to know which page asks; they are told its address, and nothing of what it shows

export class Tiles {
  constructor(changed) {
    this.changed = changed;
    this.known = new Map();
    this.names = []; // of what was drawn
  }

  // Tiles of vectors are drawn again in other colours.
  forget() {
    this.known.clear();
  }

  request(base, colours, zoom, column, row) {
    const key = `${zoom}/${column}/${row}`;
    if (this.known.has(key)) {
      const found = this.known.get(key);
      this.known.delete(key);
      this.known.set(key, found); // the newest last
      return;
    }
    const made = { image: null };
    this.known.set(key, made);
    if (this.known.size > KEPT[base.kind]) this.known.delete(this.known.keys().next().value);
    const url = base.url.replace("{z}", zoom).replace("{x}", column).replace("{y}", row);
    const got = base.kind === "vectors" ? vectors(url, colours) : picture(url);
    got.then(
      (image) => {
        made.image = image;
        if (image) this.changed();
      },
      () => setTimeout(() => this.known.get(key) === made && this.known.delete(key), AGAIN_MS),
    );
  }

  // The part of a tile that is shown at a place: of the tile itself, or of a coarser one while that is fetched.
  found(base, zoom, column, row) {
    for (let up = 0; up <= COARSER && zoom - up >= base.low; up++) {
      const image = this.known.get(`${zoom - up}/${column >> up}/${row >> up}`)?.image;
      if (!image) continue;
      const part = image.width / 2 ** up;
      return [image, (column % 2 ** up) * part, (row % 2 ** up) * part, part, part];
    }
    return null;
  }

  draw(c, view, base, colours) {
    const zoom = Math.max(base.low, Math.min(base.high, Math.round(view.zoom - Math.log2(SIZE[base.kind] / 256))));
    const count = 2 ** zoom;
    const size = (256 * view.scale) / count;
    this.names = [];
    if (size < 64) return;
    const told = new Set();
    const [left, top] = view.place([0, 0]);
    const [first, last] = [Math.max(0, Math.floor(-left / size)), Math.min(count - 1, Math.floor((view.width - left) / size))];
    const [upper, lower] = [Math.max(0, Math.floor(-top / size)), Math.min(count - 1, Math.floor((view.height - top) / size))];
    for (let column = first; column <= last; column++) {
      for (let row = upper; row <= lower; row++) {
        this.request(base, colours, zoom, column, row);
        const found = this.found(base, zoom, column, row);
        if (!found) continue;
        c.drawImage(...found, left + column * size, top + row * size, size + 0.5, size + 0.5);
        const [image, , , part] = found;
        if (!image.names || told.has(image)) continue;
        told.add(image);
        const up = Math.round(Math.log2(image.width / part)); // it is a coarser tile
        const wide = 256 / 2 ** (zoom - up);
        for (const one of image.names) this.names.push({ ...one, place: [((column >> up) + one.at[0]) * wide, ((row >> up) + one.at[1]) * wide] });
      }
    }
  }
}

// Who made the map, on top of everything.
export function attribution(c, base, colours) {
  if (!base.attribution) return;
  c.font = "11px system-ui, sans-serif";
  const words = base.attribution.slice(0, 120);
  c.fillStyle = colours.halo;
  c.fillRect(0, 0, c.measureText(words).width + 12, 17);
  c.fillStyle = colours.ink;
  c.fillText(words, 6, 12);
}

function picture(url) {
  return new Promise((done, failed) => {
    const image = new Image();
    image.onload = () => done(image.naturalWidth ? image : null);
    image.onerror = failed;
    image.referrerPolicy = REFERRER;
    image.src = url;
  });
}

async function vectors(url, colours) {
  const answer = await fetch(url, { referrerPolicy: REFERRER });
  if (answer.status === 204 || answer.status === 404) return null;
  if (!answer.ok) throw new Error(answer.statusText);
  const bytes = new Uint8Array(await answer.arrayBuffer());
  return bytes.length && bytes.length <= MAX_BYTES ? drawn(bytes, colours) : null;
}
