"""Fleets: each field wrong, missing, not a number, of another type or misspelt is one clear line."""

import pytest

from skyway.models.base.errors import InputError
from skyway.models.drones.drone import M200_V2
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.models.drones.fleet import read_fleet
from skyway.models.drones.power import MomentumEnergy

FIELDS = {
    "mass_kg": "4.69",
    "max_payload_kg": "1.45",
    "battery_wh": "349",
    "endurance_empty_min": "38",
    "endurance_full_min": "24",
    "max_airspeed_mps": "22.5",
    "max_ground_speed_mps": "20",
    "wind_limit_mps": "12",
    "recharge_full_h": "2.24",
    "price_per_km": "1.5",
}
TEXTS = {"id": '"m200"', "name": '"Matrice"', "provider": '"Sky"'}
OPTIONAL = ("max_ground_speed_mps", "price_per_km")


def fleet_of(tmp_path, *tables: str, schema: str = 'schema = "skyway.fleet/1"'):
    path = tmp_path / "drones.toml"
    path.write_text("\n".join([schema, *tables]))
    return read_fleet(path)


def drone(extra: str = "", **changes: str | None) -> str:
    fields = {**TEXTS, **FIELDS, **changes}
    return "\n".join(["[[drone]]", *(f"{key} = {value}" for key, value in fields.items() if value is not None), extra])


def said_of(tmp_path, *tables: str, **how) -> list[str]:
    with pytest.raises(InputError) as caught:
        fleet_of(tmp_path, *tables, **how)
    return [str(fault).removeprefix(f"{tmp_path}/") for fault in caught.value.faults]


def test_a_drone_is_what_its_table_says(tmp_path):
    (one,) = fleet_of(tmp_path, drone())
    assert (one.id, one.name, one.provider) == ("m200", "Matrice", "Sky")
    assert (one.battery_j, one.endurance_empty_s, one.recharge_full_s) == (349 * 3600.0, 38 * 60.0, 2.24 * 3600.0)
    assert (one.price_per_km, one.energy, one.max_ground_speed_mps) == (1.5, None, 20.0)


def test_a_drone_based_on_the_m200_changes_only_what_it_says(tmp_path):
    (one,) = fleet_of(tmp_path, '[[drone]]\nbase = "m200-v2"\nid = "mine"\nwind_limit_mps = 10')
    assert (one.id, one.wind_limit_mps, one.name, one.provider) == ("mine", 10.0, M200_V2.name, M200_V2.provider)
    for field in ("mass_kg", "max_payload_kg", "battery_j", "endurance_empty_s", "endurance_full_s"):
        assert getattr(one, field) == pytest.approx(getattr(M200_V2, field), rel=1e-15)
    assert one.price_per_km is None


def test_a_fleet_has_several_providers(tmp_path):
    fleet = fleet_of(tmp_path, drone(), drone(id='"b"', provider='"Other"'))
    assert [(d.id, d.provider) for d in fleet] == [("m200", "Sky"), ("b", "Other")]


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize(
    ("value", "problem"),
    [
        ('"heavy"', "must be a number (got 'heavy')"),
        ('"12"', "must be a number (got '12')"),
        ("nan", "must be a number (got 'nan')"),
        ("inf", "must be a number (got 'inf')"),
        ("true", "must be a number (got 'True')"),
        ("[1]", "must be a number (got '[1]')"),
        ("{}", "must be a number (got '{}')"),
        ("2013-07-10", "must be a number (got '2013-07-10')"),
        ("-1", "out of range (got '-1'); must be "),
        ("1e9", "out of range (got '1000000000.0'); must be "),
        ("9" * 400, "must be a number (got '9999"),
    ],
    ids=["word", "text", "NaN", "infinite", "bool", "list", "table", "date", "negative", "absurd", "huge"],
)
def test_a_wrong_number_is_one_line_with_field_value_and_range(tmp_path, field, value, problem):
    (said,) = said_of(tmp_path, drone(**{field: value}))
    assert said.startswith(f"drones.toml: drone[0].{field}: {problem}")


@pytest.mark.parametrize("field", [*FIELDS, *TEXTS])
def test_a_missing_field_is_one_line_unless_it_has_a_default(tmp_path, field):
    if field in OPTIONAL:
        assert fleet_of(tmp_path, drone(**{field: None}))
    else:
        assert said_of(tmp_path, drone(**{field: None})) == [f"drones.toml: drone[0].{field}: is missing"]


@pytest.mark.parametrize("field", TEXTS)
@pytest.mark.parametrize(
    ("value", "problem"),
    [
        ("3", "must be a text that is not empty (got '3')"),
        ('""', "must be a text that is not empty (got '')"),
        ('"  "', "must be a text that is not empty (got '  ')"),
        ('"a\\nb"', "must be one line of plain text (got 'a\\nb')"),
        ('"\\u001b[2J"', "must be one line of plain text (got '\\x1b[2J')"),
    ],
)
def test_a_wrong_text_is_one_line(tmp_path, field, value, problem):
    assert said_of(tmp_path, drone(**{field: value})) == [f"drones.toml: drone[0].{field}: {problem}"]


@pytest.mark.parametrize(
    ("field", "meant"),
    [("wind_limit_ms", "wind_limit_mps"), ("max_payload", "max_payload_kg"), ("endurance_full", "endurance_full_min")],
)
def test_a_misspelt_field_is_named_with_the_right_one(tmp_path, field, meant):
    (said,) = said_of(tmp_path, drone(f"{field} = 5"))
    assert said == f"drones.toml: drone[0].{field}: is not a field here; did you mean {meant}?"


def test_a_field_like_no_other_shows_those_there_are(tmp_path):
    (said,) = said_of(tmp_path, drone("colour = 5"))
    assert said.startswith("drones.toml: drone[0].colour: is not a field here; known: base, battery_wh, ")


def test_a_package_that_lets_it_fly_longer_is_a_slip(tmp_path):
    (said,) = said_of(tmp_path, drone(endurance_full_min="40"))
    assert said == "drones.toml: drone[0].endurance_full_min: is longer than endurance_empty_min (got '40.0')"


def test_a_battery_in_another_unit_is_refused_with_what_it_may_hold(tmp_path):
    (said,) = said_of(tmp_path, drone(battery_wh="349296"))
    assert said.startswith(
        "drones.toml: drone[0].battery_wh: is more than any battery of 4.69 kg holds (got '349296.0')"
    )
    assert said.endswith("from 3.0 Wh to 9380 Wh for 4.69 kg and endurance_empty_min")
    (said,) = said_of(tmp_path, drone(battery_wh="1"))
    assert "too little to fly for endurance_empty_min (got '1.0')" in said


def test_all_faults_of_all_drones_are_said_at_once(tmp_path):
    said = said_of(tmp_path, drone(mass_kg="nan", colour="1"), drone(), drone(wind_limit_mps="0"))
    assert [line.split(": ")[1] for line in said] == [
        "drone[0].mass_kg",
        "drone[0].colour",
        "drone[2].wind_limit_mps",
        "drone[1].id",
        "drone[2].id",
    ]
    assert "two drones have the same id (got 'm200')" in said[-1]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "drones.toml: drone: the fleet is empty; add a [[drone]] table"),
        ("drone = 3", "drones.toml: drone: must be a list of tables (got '3')"),
        ("[drone]\nid = 'x'", "drones.toml: drone: must be a list of tables"),
        ("drone = [1]", "drones.toml: drone[0]: must be a table (got '1')"),
        ("drones = []", "drones.toml: drones: is not a field here; did you mean drone?"),
        ("[[drone]\n", "drones.toml:2: is not TOML"),
        ("drone = [" + "{}," * 1001 + "]", "drones.toml: drone[0].mass_kg: is missing"),
    ],
)
def test_what_is_no_fleet_is_refused(tmp_path, text, said):
    assert said_of(tmp_path, text)[0].startswith(said)


def test_a_fleet_of_another_schema_is_refused(tmp_path):
    (said,) = said_of(tmp_path, drone(), schema='schema = "skyway.fleet/2"')
    assert said == "drones.toml: schema: is not known (got 'skyway.fleet/2'); one of skyway.fleet/1"


def test_an_unknown_base_is_refused_with_those_there_are(tmp_path):
    (said,) = said_of(tmp_path, drone('base = "m300"'))
    assert said == "drones.toml: drone[0].base: is not known (got 'm300'); one of none, m200-v2"


def test_what_is_believed_of_a_drones_energy_may_be_stated(tmp_path):
    (one,) = fleet_of(tmp_path, drone("energy_belief = {sd_between = 0.02, mean_ratio = 1.05}"))
    assert one.energy_belief == EnergyBelief(1.05, 0.02)
    (said,) = said_of(tmp_path, drone("energy_belief = {sd_within = -0.1}"))
    assert said.startswith("drones.toml: drone[0].energy_belief.sd_within: out of range")


MOMENTUM = 'energy_model = "momentum"\n'


def test_a_drone_may_follow_momentum_theory(tmp_path):
    (one,) = fleet_of(
        tmp_path, drone(MOMENTUM + "[drone.momentum]\nair_density_kg_m3 = 1.1\ncruise = {b1 = 60, b0 = 5}")
    )
    assert isinstance(one.energy, MomentumEnergy)
    assert one.energy.air_density_kg_m3 == 1.1
    assert one.energy.coefficients == {"climb": (80.4, 13.8), "cruise": (60.0, 5.0), "descent": (71.5, -24.3)}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('energy_model = "magic"', "energy_model: is not known (got 'magic'); one of endurance, momentum"),
        ("[drone.momentum]\n", 'momentum: is not used; energy_model = "momentum" uses it'),
        (MOMENTUM + "momentum = 3", "momentum: must be a table (got '3')"),
        (MOMENTUM + "[drone.momentum]\nair_density_kg_m3 = 1225", "momentum.air_density_kg_m3: out of range"),
        (
            MOMENTUM + "[drone.momentum]\ncruise = {b1 = 0}",
            "momentum.cruise.b1: out of range (got '0'); must be above 0",
        ),
        (MOMENTUM + "[drone.momentum]\ncruise = {b1 = nan}", "momentum.cruise.b1: must be a number (got 'nan')"),
        (MOMENTUM + "[drone.momentum]\nhover = {}", "momentum.hover: is not a field here"),
        (MOMENTUM + "[drone.momentum]\nclimb = {b2 = 1}", "momentum.climb.b2: is not a field here; known: b0, b1"),
        (
            MOMENTUM + "[drone.momentum]\ndescent = {b0 = -900}",
            "momentum.descent.b0: makes the power of the empty drone",
        ),
    ],
)
def test_a_wrong_energy_model_is_one_line(tmp_path, text, said):
    (line,) = said_of(tmp_path, drone(text))
    assert line.startswith(f"drones.toml: drone[0].{said}")


def test_what_the_cold_takes_is_read_in_order_and_bounded(tmp_path):
    rows = (
        "[[drone.cold_battery]]\ntemperature_c = 20\nheld = 1\n[[drone.cold_battery]]\ntemperature_c = -10\nheld = 0.7"
    )
    assert fleet_of(tmp_path, drone(rows))[0].cold == ((-10.0, 0.7), (20.0, 1.0))
    (said,) = said_of(tmp_path, drone("[[drone.cold_battery]]\ntemperature_c = 0\nheld = 70"))
    assert "drone[0].cold_battery[0].held" in said
    (said,) = said_of(tmp_path, drone("[[drone.cold_battery]]\ntemperature_c = 0\nheld = 0.7\n" * 2))
    assert "two rows of one temperature" in said
