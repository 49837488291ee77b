// Draws Mapbox Vector Tiles (version 2) in the colours of the page: land, water, buildings, streets and borders of the schemas that are common
// (OpenMapTiles, Protomaps, Shortbread). Names of places and waters are handed on: the map puts them where those of the network leave room.
export const PIXELS = 640; // of a tile that is drawn

const LAYERS = [
  // What it is, from the bottom up, by the name of its layer.
  ["earth", /^earth$/],
  ["water", /^(water|ocean|waterway|water_polygons|water_lines|physical_line)$/],
  ["building", /^buildings?$/],
  ["street", /^(transportation|roads?|streets?)$/],
  ["border", /^(boundar(y|ies)|admin)$/],
];
const WIDTHS = [
  [/motorway|highway|trunk/, 4],
  [/primary|secondary|major|tertiary/, 2.5],
  [/path|track|foot|steps|cycle|pedestrian|ferry|rail|transit/, 0.8],
];
const NAMED = /^(places?|place_labels|water_name|water_labels)$/;
const KINDS = [/country/, /state|region|province/, /city/, /town|ocean|sea|bay|lake/, /borough|suburb|village|quarter|locality/]; // the first are shown first
const MOST_NAMES = 250; // of a tile
const LONGEST = 48; // letters of a name
const [POINT, AREA] = [1, 3];
const text = new TextDecoder();

// Reads the wire format of protocol buffers; whatever is wrong with it throws.
class Reader {
  constructor(bytes, begin = 0, end = bytes.length) {
    Object.assign(this, { bytes, at: begin, end });
  }

  number() {
    let [found, worth] = [0, 1];
    for (let i = 0; i < 10; i++) {
      if (this.at >= this.end) throw new RangeError("cut off");
      const byte = this.bytes[this.at++];
      found += (byte & 127) * worth;
      if (byte < 128) return found;
      worth *= 128;
    }
    throw new RangeError("no number");
  }

  // Calls back with the number of each field and a reader of what it holds, or its number.
  fields(visit) {
    while (this.at < this.end) {
      const key = this.number();
      const [field, wire] = [Math.floor(key / 8), key % 8];
      if (wire === 0) visit(field, this.number());
      else {
        const length = wire === 2 ? this.number() : wire === 5 ? 4 : wire === 1 ? 8 : NaN;
        if (!(this.at + length <= this.end)) throw new RangeError("cut off");
        visit(field, new Reader(this.bytes, this.at, this.at + length));
        this.at += length;
      }
    }
  }

  words() {
    return text.decode(this.bytes.subarray(this.at, this.end));
  }

  numbers() {
    const found = [];
    while (this.at < this.end) found.push(this.number());
    return found;
  }
}

function layers(bytes) {
  const found = [];
  new Reader(bytes).fields((field, layer) => {
    if (field !== 3) return;
    const one = { name: "", extent: 4096, features: [], keys: [], values: [] };
    layer.fields((part, value) => {
      if (part === 1) one.name = value.words();
      else if (part === 2) one.features.push(value);
      else if (part === 3) one.keys.push(value.words());
      else if (part === 4) one.values.push(value);
      else if (part === 5) one.extent = value;
    });
    found.push(one);
  });
  return found;
}

// What a feature is, and the way of its lines as a path.
function feature(reader, layer) {
  let [kind, words, name, shape] = [0, "", "", null];
  reader.fields((field, value) => {
    if (field === 3) kind = value;
    else if (field === 4) shape = value;
    else if (field === 2) {
      const tags = value.numbers();
      for (let i = 0; i + 1 < tags.length; i += 2) {
        const key = layer.keys[tags[i]];
        if (!["class", "kind", "highway", "kind_detail", "pmap:kind", "name"].includes(key)) continue;
        const at = layer.values[tags[i + 1]];
        if (!at) continue;
        new Reader(at.bytes, at.at, at.end).fields((part, told) => {
          if (part !== 1) return;
          if (key === "name") name = told.words();
          else words += ` ${told.words()}`;
        });
      }
    }
  });
  return { kind, words, name, shape, path: shape && kind !== POINT ? path(shape, PIXELS / layer.extent) : null };
}

const signed = (n) => (n % 2 ? -(n + 1) / 2 : n / 2);

function path(shape, scale) {
  const found = new Path2D();
  let [x, y] = [0, 0];
  while (shape.at < shape.end) {
    const word = shape.number();
    const [command, count] = [word & 7, Math.floor(word / 8)];
    if (command === 7) found.closePath();
    else if (command === 1 || command === 2) {
      for (let i = 0; i < count; i++) {
        x += signed(shape.number());
        y += signed(shape.number());
        found[command === 1 ? "moveTo" : "lineTo"](x * scale, y * scale);
      }
    } else throw new RangeError("no such command");
  }
  return found;
}

// Where a point is, as shares of its tile; null where it belongs to the tile beside it.
function point(shape, extent) {
  shape.number();
  const [x, y] = [signed(shape.number()) / extent, signed(shape.number()) / extent];
  return x >= 0 && x < 1 && y >= 0 && y < 1 ? [x, y] : null;
}

// Names of the places and waters of a tile: the greater first.
function names(read) {
  const found = [];
  for (const layer of read.filter((one) => NAMED.test(one.name))) {
    for (const reader of layer.features) {
      if (found.length >= MOST_NAMES) return found;
      const one = feature(reader, layer);
      const at = one.kind === POINT && one.shape && one.name ? point(one.shape, layer.extent) : null;
      const rank = KINDS.findIndex((kinds) => kinds.test(one.words));
      if (at) found.push({ name: one.name.slice(0, LONGEST), water: /water/.test(layer.name), rank: rank < 0 ? KINDS.length : rank, at });
    }
  }
  return found.sort((a, b) => a.rank - b.rank);
}

// A tile as a picture, in the colours of the map, with the names in it.
export function drawn(bytes, colours) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = PIXELS;
  const c = canvas.getContext("2d");
  c.lineJoin = c.lineCap = "round";
  const read = layers(bytes);
  c.fillStyle = read.some((one) => one.name === "earth") ? colours.water : colours.land;
  c.fillRect(0, 0, PIXELS, PIXELS);
  for (const [what, name] of LAYERS) {
    for (const layer of read.filter((one) => name.test(one.name))) {
      for (const one of layer.features) paint(c, what, feature(one, layer), colours);
    }
  }
  canvas.names = names(read);
  return canvas;
}

// Of a street by what it is called: motorway, primary, path.
export const streetWidth = (words) => WIDTHS.find(([kinds]) => kinds.test(words))?.[1] ?? 1.4;

function paint(c, what, { kind, words, path: way }, colours) {
  if (!way) return;
  if (kind === AREA) {
    if (what === "border" || what === "street") return;
    c.fillStyle = { earth: colours.land, water: colours.water, building: colours.street }[what];
    c.globalAlpha = what === "building" ? 0.45 : 1;
    c.fill(way, "evenodd");
    c.globalAlpha = 1;
    return;
  }
  const width = streetWidth(words);
  c.strokeStyle = { water: colours.water, border: colours.faint }[what] || colours.street;
  c.lineWidth = what === "street" ? width : what === "water" ? 2 : 1;
  c.setLineDash(what === "border" ? [6, 5] : []);
  c.stroke(way);
}
