"""Remote ID as an operator gives it: secrets stay secret, wrong registrations are refused, and what does not fit is said."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.missions.examples import NEW_YORK
from skyway.models.base.errors import InputError
from skyway.models.scenario.file import read_scenario
from skyway.models.scenario.remote_id import NOBODY, RemoteId, broadcast_id, check_digit

ALPHABET = "0123456789abcdefghijklmnopqrstuvwxyz"
PUBLISHED = "FIN87astrdge12k8-xyz"
"""The example of EN 4709-002."""


def test_the_published_european_registration_is_taken_without_its_secret_digits():
    assert broadcast_id(PUBLISHED, "--operator-id") == "FIN87astrdge12k8"
    assert broadcast_id("FIN87astrdge12k8", "--operator-id") == "FIN87astrdge12k8"
    assert broadcast_id(" FA3XYZ1234 ", "--operator-id") == "FA3XYZ1234"


@given(st.text(ALPHABET, min_size=15, max_size=15), st.integers(0, 14), st.sampled_from(ALPHABET))
def test_one_wrong_character_is_always_found(body, at, other):
    whole = f"DEU{body[:12]}{check_digit(body)}-{body[12:]}"
    assert broadcast_id(whole, "x") == whole[:16]
    wrong = body[:at] + other + body[at + 1 :]
    if wrong != body:
        with pytest.raises(InputError, match="check digit"):
            broadcast_id(f"DEU{wrong[:12]}{check_digit(body)}-{wrong[12:]}", "x")


@pytest.mark.parametrize("text", ["", "x" * 21, "ünnamed", "a\nb", "FIN87astrdge12k8-xyzz", "fin87astrdge12k8-xyz"])
def test_what_cannot_be_broadcast_is_refused_and_never_cut(text):
    with pytest.raises(InputError):
        broadcast_id(text, "--operator-id")


def test_a_secret_is_not_repeated_in_the_error():
    with pytest.raises(InputError) as caught:
        broadcast_id("FIN87astrdge12k9-xyz", "--operator-id")
    assert "xyz" not in str(caught.value)


def test_what_is_typed_goes_before_the_scenario():
    own = RemoteId(operator_id="A1", self_id="parcels")
    found = own.changed("B2", None, (48.0, 11.0))
    assert (found.operator_id, found.self_id, found.lat_deg) == ("B2", "parcels", 48.0)
    assert own.given
    assert not NOBODY.given
    assert math.isnan(own.changed(None, None, None).lat_deg)


def written(folder, more):
    import shutil

    shutil.copytree(NEW_YORK, folder)
    file = folder / "scenario.toml"
    file.write_text(f"{file.read_text()}\n[remote_id]\n{more}\n")
    return folder


def test_a_scenario_names_its_operator(tmp_path):
    found = read_scenario(
        written(tmp_path / "ny", f'operator_id = "{PUBLISHED}"\nself_id = "parcels"\nlat = 40.7\nlon = -74.0')
    )
    assert found.remote_id == RemoteId(operator_id="FIN87astrdge12k8", self_id="parcels", lat_deg=40.7, lon_deg=-74.0)


def test_faults_of_the_table_are_told_with_file_and_field(tmp_path):
    more = (
        'operator_id = "FIN87astrdge12k9-xyz"\nself_id = "a text that is much too long for it"\nlat = 40.7\nname = "x"'
    )
    with pytest.raises(InputError) as caught:
        read_scenario(written(tmp_path / "ny", more))
    fields = {one.field for one in caught.value.faults}
    assert {"remote_id.operator_id", "remote_id.self_id", "remote_id.lon", "remote_id.name"} <= fields
