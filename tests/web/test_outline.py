"""The outline that an operator gives: what each shape is, and what is refused, before the page is served."""

from __future__ import annotations

import json

import pytest

from skyway.cli.main import main
from skyway.models.base.errors import InputError
from skyway.web.work.outline import shapes

RING = [[-74.0, 40.7], [-74.0, 40.8], [-73.9, 40.8], [-74.0, 40.7]]


def written(path, *features):
    rows = [{"type": "Feature", "properties": properties, "geometry": geometry} for properties, geometry in features]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": rows}))
    return str(path)


def test_shapes_are_water_land_or_streets_by_what_the_file_calls_them(tmp_path):
    line, area = {"type": "LineString", "coordinates": RING}, {"type": "Polygon", "coordinates": [RING]}
    both = {
        "type": "GeometryCollection",
        "geometries": [line, {"type": "MultiPolygon", "coordinates": [[RING], [RING]]}],
    }
    path = written(
        tmp_path / "a.geojson", ({"natural": "coastline"}, line), ({"highway": "Motorway"}, line), ({}, area), ({"natural": "water"}, area),
        ({"waterway": "river"}, line), ({"type": "lake"}, both), ({}, {"type": "Point", "coordinates": [0, 0]}), ({}, None),
    )  # fmt: skip
    found = [(one["kind"], one["words"], one["closed"]) for one in shapes(path)["shapes"]]
    assert found == [
        ("water", "", False), ("street", "motorway", False), ("land", "", True), ("water", "", True), ("water", "", False),
        ("water", "lake", False), ("water", "lake", True), ("water", "lake", True),
    ]  # fmt: skip
    assert shapes(path)["shapes"][2]["rings"] == [RING]
    written(tmp_path / "a.geojson", ({}, area), ({}, area), ({}, area))
    assert len(shapes(path)["shapes"]) == 3  # it has changed


@pytest.mark.parametrize(
    ("geometry", "why"),
    [
        ({"type": "Polygon", "coordinates": [[["x", 1], [2, 3]]]}, "not numbers"), ({"type": "Polygon", "coordinates": 7}, "not a list"),
        ({"type": "LineString", "coordinates": [[1e400, 1]]}, "not numbers"), ({"type": "LineString", "coordinates": [[1]]}, "not numbers"),
        ({"type": "GeometryCollection", "geometries": 3}, "not lists"), ({"type": "MultiPolygon", "coordinates": [7]}, "not numbers"),
    ],
    ids=["words", "number", "infinite", "short", "collection", "part"],
)  # fmt: skip
def test_what_cannot_be_drawn_is_refused_before_the_page_is_served(tmp_path, capsys, geometry, why):
    path = written(tmp_path / "a.geojson", ({}, geometry))
    with pytest.raises(InputError, match=why):
        shapes(path)
    assert main(["serve", "--outline", path]) == 2
    assert why in capsys.readouterr().err


def test_more_points_than_a_map_draws_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("skyway.web.work.outline.MAX_POINTS", 7)
    line = {"type": "LineString", "coordinates": RING}
    assert shapes(written(tmp_path / "few.geojson", ({}, line)))["shapes"]
    with pytest.raises(InputError, match="too many points"):
        shapes(written(tmp_path / "many.geojson", ({}, line), ({}, line)))


def test_collections_without_end_are_refused(tmp_path):
    deep = {"type": "Point", "coordinates": [0, 0]}
    for _ in range(60):
        deep = {"type": "GeometryCollection", "geometries": [deep]}
    with pytest.raises(InputError, match="too deep"):
        shapes(written(tmp_path / "a.geojson", ({}, deep)))


def test_a_file_that_is_not_there_is_named(capsys, tmp_path):
    assert main(["serve", "--outline", str(tmp_path / "none.geojson")]) == 2
    assert "none.geojson" in capsys.readouterr().err
