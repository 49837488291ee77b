"""How errors of forecasts hang together: found again where it is known, and made again in the members."""

import numpy as np
import pytest

from skyway.models.base.errors import InputError
from skyway.models.base.geodesy import inverse
from skyway.models.weather.error_shape import ErrorShape, in_wind, learn_shape
from skyway.models.weather.lead_error import LeadError, lead_error_text, read_lead_error, with_errors

WHERE = np.array([(40.6, -73.8), (40.7, -74.2), (40.8, -73.9), (40.8, -73.1)])
HOURS = 24
DISTANCE_M = np.asarray(inverse(WHERE[:, None, 0], WHERE[:, None, 1], WHERE[None, :, 0], WHERE[None, :, 1])[0])


def errors(true: ErrorShape, issues=300, seed=3):
    """Errors of mean square about 1 of the shape, drawn as one Gaussian vector an issue: no walk from hour to hour, as members are made."""
    rng = np.random.default_rng(seed)
    hour = np.abs(np.arange(HOURS)[:, None] - np.arange(HOURS))
    alike = np.kron(np.exp(-hour * 3600.0 / true.tau_s), np.exp(-DISTANCE_M / true.length_m))
    root = np.linalg.cholesky((1.0 - true.brief) * alike + (true.brief + 1e-9) * np.eye(len(alike)))
    count = len(alike)
    speed = 5.0 * np.sqrt(rng.chisquare(2, (issues, count)) / 2.0)
    size = np.exp(true.severity * rng.standard_normal(issues))
    found = np.einsum("ij,njc->nic", root, rng.standard_normal((issues, count, 2)))
    found *= (size[:, None] * np.sqrt(in_wind(true.doubling_mps, speed)))[..., None]
    found /= np.sqrt((found**2).mean())
    issue = np.repeat(np.arange(issues), count)
    lead_s = np.tile(np.repeat(np.arange(HOURS) * 3600.0, len(WHERE)), issues)
    place = np.tile(np.arange(len(WHERE)), issues * HOURS)
    return found.reshape(-1, 2), speed.ravel(), issue, place, lead_s, WHERE


@pytest.mark.parametrize(
    "true",
    [
        ErrorShape(doubling_mps=6.0, tau_s=4 * 3600.0, length_m=40_000.0, brief=0.3, severity=0.3),
        ErrorShape(doubling_mps=0.0, tau_s=12 * 3600.0, length_m=140_000.0, brief=0.0, severity=0.0),
    ],
)
def test_a_known_shape_is_found(true):
    found = learn_shape(*errors(true))
    assert found.tau_s == pytest.approx(true.tau_s, rel=0.55)
    assert found.length_m == pytest.approx(true.length_m, rel=0.55)
    assert found.brief == pytest.approx(true.brief, abs=0.1)
    assert found.severity == pytest.approx(true.severity, abs=0.12)
    assert found.doubling_mps == pytest.approx(true.doubling_mps, rel=0.3, abs=0.1)


def test_few_pairs_tell_nothing_of_how_errors_hang_together():
    assert learn_shape(*errors(ErrorShape(), issues=5)) == ErrorShape()


def test_members_err_as_was_learnt():
    true = ErrorShape(doubling_mps=6.0, tau_s=4 * 3600.0, length_m=40_000.0, brief=0.3, severity=0.3)
    error = LeadError(
        source="test", height_m=10.0, lead_h=(0.0,), sigma_mps=(1.5,), tau_s=true.tau_s, length_m=true.length_m,
        brief=true.brief, severity=true.severity, doubling_mps=true.doubling_mps, usual_mps=5.0,
    )  # fmt: skip
    wind = np.linspace(0.0, 10.0, HOURS)
    made = with_errors(
        np.repeat(wind[:, None], len(WHERE), axis=1)[None], np.zeros((1, HOURS, len(WHERE))), np.arange(HOURS) * 3600.0, DISTANCE_M,
        error, factor=1.2, slot_s=3600.0, members=2000, seed=1,
    )  # fmt: skip
    off = np.stack((made.north - wind[:, None], made.east))
    np.testing.assert_allclose(off.mean(axis=1), 0.0, atol=1e-12)  # pairs of opposite sign
    half = made.north[1::2] - wind[:, None]
    np.testing.assert_allclose(half.mean(axis=0), 0.0, atol=1e-12)  # of every second member, too
    wanted = 1.2 * 1.5 * np.sqrt((1.0 + (wind / 1.2 / 6.0) ** 2) / (1.0 + (5.0 / 6.0) ** 2))
    np.testing.assert_allclose(off.std(axis=(0, 1, 3)), wanted, rtol=0.08)
    z = off / wanted[:, None]
    assert (z[:, :, 3:] * z[:, :, :-3]).mean() == pytest.approx(0.7 * np.exp(-3.0 / 4.0), abs=0.05)
    assert (z[..., 0] * z[..., 1]).mean() == pytest.approx(0.7 * np.exp(-DISTANCE_M[0, 1] / 40_000.0), abs=0.05)
    assert (z**4).mean() == pytest.approx(3.0 * np.exp(4.0 * 0.3**2), rel=0.2)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 3), (4, 1), (3, 4)])
def test_errors_between_the_nodes_of_a_lattice_are_as_large_as_was_learnt(rows, columns):
    lat, lon = np.linspace(40.5, 41.0, rows), np.linspace(-74.3, -73.5, columns)
    grid = [one.ravel() for one in np.meshgrid(lat, lon, indexing="ij")]
    distance_m, _ = inverse(grid[0][:, None], grid[1][:, None], grid[0][None], grid[1][None])
    error = LeadError(
        source="test", height_m=10.0, lead_h=(0.0,), sigma_mps=(1.5,), length_m=30_000.0, brief=0.35
    )  # fmt: skip
    calm = np.zeros((1, 6, rows * columns))
    made = with_errors(
        calm, calm, np.arange(6) * 3600.0, distance_m, error, factor=1.0, slot_s=3600.0, members=1200, seed=1, lattice=(rows, columns)
    )  # fmt: skip
    rng = np.random.default_rng(2)
    row, column = (rng.uniform(0.0, count - 1, 400) for count in (rows, columns))
    at = np.zeros((400, rows * columns))
    for place in range(400):  # bilinear, written out
        for i in range(rows):
            for j in range(columns):
                near = max(1.0 - abs(row[place] - i), 0.0) * max(1.0 - abs(column[place] - j), 0.0)
                at[place, i * columns + j] = near
    off = np.stack((made.north, made.east)) @ at.T
    alone = (2.0 / 3.0) ** (
        (rows > 1) + (columns > 1)
    )  # of what is of one place alone: the mean of the squared weights, and no more
    assert (off**2).mean() == pytest.approx(1.5**2 * (0.65 + 0.35 * alone), rel=0.07)


@pytest.mark.parametrize("wrong", ["length_m", "brief", "severity", "doubling_mps", "usual_mps"])
def test_a_file_with_an_impossible_shape_is_refused(tmp_path, wrong):
    import msgspec

    usual = LeadError(source="test", height_m=10.0, lead_h=(0.0,), sigma_mps=(1.5,), usual_mps=5.0, doubling_mps=7.0)
    path = tmp_path / "error.json"
    path.write_text(lead_error_text(usual))
    assert read_lead_error(path) == usual
    path.write_text(lead_error_text(msgspec.structs.replace(usual, **{wrong: -1.0})))
    with pytest.raises(InputError, match=r"error\.json: figures are missing, or cannot be"):
        read_lead_error(path)
