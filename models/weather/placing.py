"""Values at the points of a grid, or of stations, interpolated to other places."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.formatting import distance_text
from skyway.models.base.geodesy import inverse
from skyway.models.weather.weather import Box
from skyway.models.wind.interpolation import weights_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.weather.weather import Weather

STATION_FAR_M = 80_000.0
"""Beyond this distance, a station, or a single point of a model, is not representative."""
M_PER_DEG = 111_195.0


class Placing:
    """Weights of a series' points at places, degrees, shape (places, points); linear on triangles between the points of a grid.

    Triangles work for any grid, however it is turned or thinned. Between stations the inverse square of the distance counts. An `InputError`
    means that the places are outside.
    """

    def __init__(self, weather: Weather, lat: NDArray[np.float64], lon: NDArray[np.float64], region: Box) -> None:
        places = weather.places
        known = np.isfinite(places.lat) & np.isfinite(places.lon)
        if not known.any():
            raise _elsewhere(weather, region, lat, lon) if len(places) == 0 else _nowhere(weather)
        used = np.flatnonzero(known & _measured(weather))
        if not len(used):
            raise _empty(weather)
        middle = float(lat.mean()), float(lon.mean())
        points, wanted = _plane(places.lat[used], places.lon[used], middle), _plane(lat, lon, middle)
        self.used = used
        on_grid = self._on_grid(points, wanted, places.spacing_m)
        if on_grid is not None:
            self.weights = on_grid
        else:
            distance, _ = inverse(lat[:, None], lon[:, None], places.lat[used][None], places.lon[used][None])
            limit = max(STATION_FAR_M, 1.5 * np.nan_to_num(places.spacing_m))
            if float(distance.min(axis=1).max()) > limit:
                raise _elsewhere(weather, region, lat, lon)
            self.weights = weights_at(distance)

    @staticmethod
    def _on_grid(
        points: NDArray[np.float64], wanted: NDArray[np.float64], spacing_m: float
    ) -> NDArray[np.float64] | None:
        """Weights by triangles; None if there are none, or if a place is farther outside than the points are apart."""
        from scipy.spatial import Delaunay, QhullError

        if not np.isfinite(spacing_m) or len(points) < 3:
            return None
        try:
            triangles = Delaunay(points, qhull_options="Qbb Qc Qz QJ" if len(points) < 5 else "Qbb Qc Qz Q12")
        except QhullError:
            return None
        found = np.zeros((len(wanted), len(points)))
        corners = points[triangles.simplices]  # (triangle, corner, 2)
        double = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        sound = np.abs(double) > 1e-9 * spacing_m**2
        for row, place in enumerate(wanted):
            ways = corners - place
            parts = np.stack([_cross(ways[:, (k + 1) % 3], ways[:, (k + 2) % 3]) for k in range(3)], axis=1)
            shares = np.where(sound[:, None], parts / np.where(sound, double, 1.0)[:, None], -np.inf)
            best = int(np.argmax(shares.min(axis=1)))
            if shares[best].min() >= -1e-9:
                found[row, triangles.simplices[best]] = shares[best]
                continue
            away = np.hypot(*(points - place).T)
            if away.min() > 1.5 * spacing_m:
                return None
            found[row, int(np.argmin(away))] = 1.0
        return found

    def __call__(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Interpolate values, shape (…, points), to the places, shape (…, places); a gap is tolerated if half of the weight is known."""
        part = values[..., self.used]
        if not np.isnan(part).any():
            return np.asarray(part @ self.weights.T)
        known = np.isfinite(part).astype(np.float64) @ self.weights.T
        total = np.nan_to_num(part) @ self.weights.T
        return np.where(known >= 0.5, total / np.where(known >= 0.5, known, 1.0), np.nan)


def _cross(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cross products of vectors in the plane, shape (…,); scipy's point location starts threads, which stall on a busy machine."""
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def _measured(weather: Weather) -> NDArray[np.bool_]:
    """Points that have any value: grids of the sea have none on land."""
    found = np.zeros(len(weather.places), dtype=bool)
    for values in weather.fields.values():
        found |= np.isfinite(values).any(axis=(0, 1))
    return found


def _plane(lat: NDArray[np.float64], lon: NDArray[np.float64], middle: tuple[float, float]) -> NDArray[np.float64]:
    """Metres (east, north) from the middle of a region, good enough to triangulate, shape (places, 2)."""
    east = (np.mod(lon - middle[1] + 180.0, 360.0) - 180.0) * np.cos(np.radians(middle[0]))
    return M_PER_DEG * np.column_stack((east, lat - middle[0]))


def _nowhere(weather: Weather) -> InputError:
    names = ", ".join(weather.places.names) or weather.model
    problem = f"does not state the position of {names} is"
    return InputError(
        problem, weather.name, remedy="name it in [[wind.sites]] with its identifier (icao), latitude and longitude"
    )


def _empty(weather: Weather) -> InputError:
    where = weather.places.box
    problem = "has no value at its points here, only gaps" + ("" if where is None else f" ({where})")
    return InputError(problem, weather.name, remedy="ask for a forecast that has values in this region")


def _elsewhere(weather: Weather, wanted: Box, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> InputError:
    box = weather.places.box
    where = "the wind there is missing" if box is None else f"it covers {box}"
    problem = f"does not cover the region ({wanted}); {where}"
    if box is not None and box.north - box.south < 90.0:
        swapped = Box(box.west, box.south, box.east, box.north).wider(1.0)
        if abs(box.west) <= 90.0 and swapped.holds(lat, lon).all():
            return InputError(problem, weather.name, remedy="its lat and lon look swapped")
        if box.single:
            away = float(inverse(lat, lon, np.full(len(lat), box.south), np.full(len(lon), box.west))[0].max())
            problem += f", up to {distance_text(away)} away"
    return InputError(problem, weather.name, remedy="ask for a forecast of this region")
