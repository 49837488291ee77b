"""One meaning, one name and one unit for every version of firmware; what a vehicle does not have is known at once."""

import pytest
from wires import LAT, LON, Scene, bad_radio

from benchmarks.link.deliveries import Stage, Story
from skyway.link.protocol.parameter_file import read_required
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions.autopilots.registry import FAMILIES, family_named
from skyway.missions.items.parameters import FlightNeeds, Parameter
from skyway.models.base.errors import InputError, LinkError, ParameterAbsentError, VehicleTimeoutError
from skyway.sim_stub.autopilot.registry import FAMILIES as SIMULATED
from skyway.sim_stub.config import VehicleConfig

VERSIONS = [(family, version) for family, simulated in SIMULATED.items() for version in simulated.FIRMWARES]
EVERYTHING = FlightNeeds(17.0, 4.0, 2.0, 95.0, fenced=True, has_rally_points=True, continues_after_landing=True)
SOON_S = 5.0


def aboard(family, firmware="", **how):
    scene = Scene(family, firmware=firmware, **how)
    scene.meet()
    scene.craft = Vehicle(scene.connection, 1)
    return scene


def needs_of(family, **more):
    return family_named(family).parameters(EVERYTHING if not more else FlightNeeds(17.0, 4.0, 2.0, 95.0, **more))


def rename(scene, old, new):
    """What a firmware of the future may do."""
    store = scene.vehicle.autopilot.parameters
    parameter = store.find(old)
    parameter.name = new
    del store._by_name[old]
    store._by_name[new] = parameter
    store._index[new] = store._index.pop(old)


@pytest.mark.parametrize(("family", "version"), VERSIONS)
def test_what_a_mission_needs_is_read_and_set_on_every_version(family, version):
    scene = aboard(family, version)
    begun = scene.lockstep.now_s
    checks = scene.craft.check_required(needs_of(family))
    assert scene.lockstep.now_s - begun < SOON_S
    assert not [str(check) for check in checks if check.absent or check.actual is None]
    for check in checks:
        if check.to_set is not None:
            scene.craft.set_parameter(check.wanted.name, check.to_set)
    assert all(check.ok for check in scene.craft.check_required(needs_of(family)))
    speeds = scene.vehicle.autopilot.read_speeds()  # what the vehicle makes of it, in its own code
    assert (speeds.cruise_mps, speeds.up_mps, speeds.down_mps) == pytest.approx((17.0, 4.0, 2.0))
    height = {"px4": "RTL_RETURN_ALT", "ardupilot": "RTL_ALT"}[family]
    assert scene.vehicle.autopilot.parameters[height] == pytest.approx({"px4": 95.0, "ardupilot": 9500.0}[family])


@pytest.mark.parametrize(("family", "version"), VERSIONS)
def test_a_vehicle_tells_which_version_it_is(family, version):
    told = aboard(family, version).craft.identify().version
    assert told.startswith("1.19" if version == "main" else version)


@pytest.mark.parametrize(("version", "wanted"), [("1.15", 0.0), ("1.16", 0.0), ("main", 5.0)])
def test_a_return_never_goes_home_where_the_firmware_knows_how(version, wanted):
    scene = aboard("px4", version)
    found = next(c for c in scene.craft.check_required(needs_of("px4")) if c.wanted.name == "RTL_TYPE")
    assert found.wanted.value == wanted


def test_a_mission_goes_on_without_a_link_also_before_there_were_exceptions():
    scene = aboard("px4", "1.15", parameters=(("NAV_DLL_ACT", 2.0),))
    found = [c for c in scene.craft.check_required(needs_of("px4")) if c.wanted.name == "NAV_DLL_ACT"]
    assert [c.to_set for c in found] == [0.0, None]


@pytest.mark.parametrize(("version", "name"), [("1.15", "PD_GRIPPER_EN"), ("main", "PD_GRIPPER_TYPE")])
def test_a_gripper_is_enabled_as_each_version_wants(version, name):
    scene = aboard("px4", version)
    (found,) = (
        c for c in scene.craft.check_required(needs_of("px4", uses_gripper=True)) if c.wanted.key.startswith("grip")
    )
    assert found.wanted.name == name
    scene.craft.set_parameter(name, found.to_set)
    assert scene.vehicle.autopilot.has_gripper


def test_a_build_without_a_gripper_is_known_at_once():
    scene = aboard("px4", "1.16")
    for name in ("PD_GRIPPER_EN", "PD_GRIPPER_TYPE", "PD_GRIPPER_TO"):
        rename(scene, name, f"X{name[1:]}")
    begun = scene.lockstep.now_s
    found = scene.craft.check_required(needs_of("px4", uses_gripper=True))[-1]
    assert found.absent
    assert "has no PD_GRIPPER_EN or PD_GRIPPER_TYPE" in found.problem
    assert scene.lockstep.now_s - begun < SOON_S


@pytest.mark.parametrize(("family", "version"), VERSIONS)
def test_an_unknown_name_is_told_from_a_lost_link(family, version):
    scene = aboard(family, version)
    begun = scene.lockstep.now_s
    with pytest.raises(ParameterAbsentError, match="NO_SUCH"):
        scene.craft.parameter("NO_SUCH")
    assert scene.lockstep.now_s - begun < SOON_S
    scene.link.spoil = lambda *_: b""
    with pytest.raises(VehicleTimeoutError):
        scene.craft.parameter("NO_SUCH")


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("version", ["4.6", "4.7"])
def test_on_a_bad_radio_nothing_that_is_there_is_taken_for_absent(version, seed):
    scene = aboard("ardupilot", version, impairment=bad_radio(0.4), seed=seed)
    names = [scene.vehicle.autopilot.parameters.at(number).name for number in range(0, 80, 4)]
    read = scene.craft.read_parameters([*names, "NO_SUCH", "NOR_THIS"])
    assert not read.absent & set(names)
    assert set(read.found) <= set(names)
    assert read.absent <= {"NO_SUCH", "NOR_THIS"}
    if len(read.found) == len(names):
        assert read.absent


@pytest.mark.parametrize("key", ["mission-speed", "return-height", "failsafe-options", "low-battery"])
def test_a_name_of_the_future_is_known_at_once_and_can_be_given(key):
    scene = aboard("ardupilot", "4.8")
    old = family_named("ardupilot").settings[key].names[0].name
    rename(scene, old, "ZZ_FUTURE")
    begun = scene.lockstep.now_s
    (found,) = (c for c in scene.craft.check_required(needs_of("ardupilot")) if c.wanted.key == key)
    assert scene.lockstep.now_s - begun < SOON_S
    assert found.absent
    assert not found.ok
    assert old in found.problem
    assert f"--parameter-name {key}=" in found.problem
    scene.craft.own_names = {key: ("ZZ_FUTURE", found.wanted.unit)}
    (found,) = (c for c in scene.craft.check_required(needs_of("ardupilot")) if c.wanted.key == key)
    assert found.actual is not None
    assert found.wanted.name == "ZZ_FUTURE"


def test_a_value_that_cannot_be_is_not_believed_nor_set():
    """A build that has the new name with the old unit: 1000 cm/s would be 1000 m/s, and more than enough."""
    scene = aboard("ardupilot", "4.7")
    scene.vehicle.autopilot.parameters.set("WP_SPD", 1000.0)
    found = scene.craft.check_required(needs_of("ardupilot"))[0]
    assert (found.ok, found.to_set) == (False, None)
    assert "another unit" in found.problem


@pytest.mark.parametrize(("family", "version"), VERSIONS)
def test_a_parameter_file_for_one_version_serves_every_other(family, version, tmp_path):
    autopilot, file = FAMILIES[family], tmp_path / "m.param"
    file.write_text(autopilot.parameter_file(needs_of(family), version))
    wanted = read_required(file)
    has = aboard(family, version).vehicle.autopilot.parameters
    written = [line.split(",")[0] for line in file.read_text().splitlines() if not line.startswith("#")]
    assert written
    assert all(has.find(name) is not None for name in written)
    for other in SIMULATED[family].FIRMWARES:
        scene = aboard(family, other)
        for check in scene.craft.check_required(wanted):
            assert not check.absent, check.problem
            if check.to_set is not None:
                scene.craft.set_parameter(check.wanted.name, check.to_set)
        speeds = scene.vehicle.autopilot.read_speeds()
        assert (speeds.cruise_mps, speeds.up_mps, speeds.down_mps) == pytest.approx((17.0, 4.0, 2.0))


def test_a_parameter_of_no_known_meaning_is_asked_for_by_its_name():
    scene = aboard("ardupilot", "4.7")
    (found,) = scene.craft.check_required([Parameter("RTL_LOIT_TIME", "equal", 1000.0, "why not")])
    assert (found.actual, found.to_set) == (5000.0, 1000.0)


@pytest.mark.parametrize(("family", "firmware"), [("px4", "4.6"), ("ardupilot", "main"), ("ardupilot", "3.6")])
def test_a_version_that_is_not_simulated_is_refused(family, firmware):
    with pytest.raises(InputError, match="is simulated as"):
        VehicleConfig(lat=LAT, lon=LON, autopilot=family, firmware=firmware)


def test_a_refused_setting_is_told_with_the_vehicles_reason():
    scene = aboard("ardupilot", "4.7")
    scene.vehicle.autopilot.parameters.set = lambda *_: False
    with pytest.raises(LinkError, match="it is 10"):
        scene.craft.set_parameter("WP_SPD", 12.0)


def test_a_setting_that_the_vehicle_limits_is_told_with_its_value_now_and_before():
    scene = aboard("ardupilot", "4.7")
    store = scene.vehicle.autopilot.parameters
    taken = store.set
    store.set = lambda name, value, *how, **more: taken(name, min(value, 11.0), *how, **more)
    with pytest.raises(LinkError, match="set WP_SPD to 12: it is 11 now, and was 10 before"):
        scene.craft.set_parameter("WP_SPD", 12.0)


@pytest.mark.slow
@pytest.mark.parametrize(("family", "version"), VERSIONS)
def test_a_package_is_delivered_under_every_version(family, version, tmp_path):
    story = Story(
        autopilot=family, start="bellevue", to="yankee-stadium", soc=0.42, traffic=False, vehicle={"firmware": version}
    )
    stage = Stage(story, tmp_path)
    outcome = stage.fly()
    assert outcome.delivered, outcome
    assert stage.craft.station() == "yankee-stadium"
    assert stage.craft.body.payload_kg == 0.0
    assert not stage.craft.autopilot.armed
