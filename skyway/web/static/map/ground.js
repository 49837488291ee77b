// Heights of the ground as a picture: lit from the north-west, higher ground darker on light pages and lighter on dark ones.
import { mercator } from "skyway-map/view.js";

const STEEP = 0.6; // how strongly slopes show
const [SHADE, TINT] = [0.3, 0.28]; // of slopes, and of the highest ground

export function shaded(c, view, found, colours) {
  if (found.colour !== colours.ink) {
    found.colour = colours.ink;
    found.picture = picture(found, channels(colours.ink));
  }
  const [west, south, east, north] = found.box;
  const [left, top] = view.place(mercator(north, west));
  const [right, bottom] = view.place(mercator(south, east));
  if (right > 0 && bottom > 0 && left < view.width && top < view.height) c.drawImage(found.picture, left, top, right - left, bottom - top);
}

function channels(colour) {
  return [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16) || 0);
}

function picture({ rows, columns, heights_m: heights, box }, ink) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [columns, rows];
  const c = canvas.getContext("2d");
  const image = c.createImageData(columns, rows);
  const known = heights.filter((one) => one !== null);
  const low = known.reduce((a, b) => Math.min(a, b), Infinity);
  const span = Math.max(known.reduce((a, b) => Math.max(a, b), -Infinity) - low, 40);
  const cell = ((box[2] - box[0]) / columns) * 111320 * Math.cos((((box[1] + box[3]) / 2) * Math.PI) / 180);
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const at = row * columns + column;
      if (heights[at] === null) continue;
      const before = heights[Math.max(row - 1, 0) * columns + Math.max(column - 1, 0)] ?? heights[at];
      const slope = (heights[at] - before) / cell; // falling away from the light is in the shade
      const dark = TINT * ((heights[at] - low) / span) + SHADE * Math.max(-1, Math.min(1, -slope / STEEP));
      image.data.set([...ink, 255 * Math.max(0, Math.min(0.6, dark + 0.02))], 4 * at);
    }
  }
  c.putImageData(image, 0, 0);
  return canvas;
}
