// Figures in words, in the units and the zone of time that a person prefers; what is not known says so.
const UNKNOWN = "unknown";

export const known = (x) => x !== null && x !== undefined && Number.isFinite(x);

export function figure(x, factor, unit, digits = 0) {
  return known(x) ? `${(x * factor).toFixed(digits)} ${unit}` : UNKNOWN;
}

export const percent = (x, digits = 0) => figure(x, 100, "%", digits);

export function probability(p) {
  if (!known(p)) return UNKNOWN;
  if (p <= 0) return "0 %";
  if (p < 0.001) return "<0.1 %";
  return p > 0.999 && p < 1 ? ">99.9 %" : `${(100 * p).toFixed(1)} %`;
}

export function duration(seconds, signed = false) {
  if (!known(seconds)) return UNKNOWN;
  const sign = seconds < 0 ? "-" : signed ? "+" : "";
  const s = Math.abs(seconds);
  if (s < 59.5) return `${sign}${s.toFixed(0)} s`;
  if (s < 595) return `${sign}${(s / 60).toFixed(1)} min`;
  const minutes = Math.round(s / 60);
  return minutes < 60 ? `${sign}${minutes} min` : `${sign}${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

export function clock(posix, view) {
  if (!known(posix)) return UNKNOWN;
  const zone = view.utc ? "UTC" : view.zone || "UTC";
  return new Date(1000 * posix).toLocaleTimeString("sv-SE", { timeZone: zone, hour12: false });
}

// A sentence of the supervisor or of a log, with its speeds, heights and lengths in the units that are preferred; `Preferences.in_words` does the same.
const NUMBER = /(?<![\w.])-?\d+(?:\.\d+)?/g;
const MEASURED = /(?<![\w.])(-?\d+(?:\.\d+)?(?: ?(?:±|to|\() ?-?\d+(?:\.\d+)?\)?)*) (m\/s|m)(?![\w²³/·])/g;

export function inWords(told, view) {
  if (!told || (view.speedUnit === "m/s" && view.heightUnit === "m")) return told;
  return told.replace(MEASURED, (whole, numbers, unit) => {
    const speed = unit === "m/s";
    const [factor, shown] = speed ? [view.speedFactor, view.speedUnit] : [view.heightFactor, view.heightUnit];
    if (shown === unit) return whole;
    return `${numbers.replace(NUMBER, (x) => (Number(x) * factor).toFixed(speed ? 1 : (x.split(".")[1] || "").length))} ${shown}`;
  });
}

// Short name of the zone of time that is shown, at a time: EDT, UTC, GMT+2.
export function zoneName(posix, view) {
  const zone = view.utc ? "UTC" : view.zone || "UTC";
  const parts = new Intl.DateTimeFormat("en-US", { timeZone: zone, timeZoneName: "short" }).formatToParts(new Date(1000 * posix));
  return parts.find((one) => one.type === "timeZoneName").value;
}

export function wind(one, view) {
  if (!one || !known(one.north_mps) || !known(one.east_mps)) return UNKNOWN;
  const speed = Math.hypot(one.north_mps, one.east_mps);
  const from = Math.round(((Math.atan2(-one.east_mps, -one.north_mps) * 180) / Math.PI + 360) % 360);
  const sure = known(one.sigma_mps) ? ` ± ${(one.sigma_mps * view.speedFactor).toFixed(1)}` : "";
  return `${(speed * view.speedFactor).toFixed(1)}${sure} ${view.speedUnit} from ${String(from).padStart(3, "0")}°`;
}
