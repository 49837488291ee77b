"""``skyway evaluate``: a plan, or the online policy, on days that the forecast was not told."""

import json

import pytest

REQUEST = [
    "evaluate", "--from", "bellevue", "--to", "jacobi", "--payload", "0.8", "--depart", "2013-07-10T14:00-04:00", "--drone", "m200",
    "--days", "4",
]  # fmt: skip


@pytest.mark.parametrize("online", [False, True])
def test_every_simulated_delivery_is_counted_once(skyway, online):
    runs = 8 if online else 200
    done = skyway(*REQUEST, "--runs", str(runs), "--json", *(["--online"] if online else []))
    found = json.loads(done.out)
    assert found["schema"] == "skyway.evaluation/1"
    assert (found["runs"], found["days"]) == (runs, 4)
    counts = found["counts"]
    assert counts["delivered"] + counts["stranded"] + counts["unflyable"] + counts["gave_up"] == runs
    assert found["mean_s"]["low"] <= found["mean_s"]["value"] <= found["mean_s"]["high"]


def test_the_figures_name_what_is_needed_to_repeat_them(skyway):
    found = json.loads(skyway(*REQUEST, "--runs", "8", "--seed", "3", "--planner", "pfs", "--json").out)
    assert (found["from"], found["to"], found["depart"], found["seed"]) == (
        "bellevue",
        "jacobi",
        "2013-07-10T18:00:00Z",
        3,
    )
    assert (found["drone"], found["payload_kg"], found["parameters"]) == ("m200", 0.8, {})
    assert len(found["scenario"]["sha256"]) == 64
    assert len(set(found["held_out"])) == 4
    again = json.loads(skyway(*REQUEST, "--runs", "8", "--seed", "3", "--planner", "pfs", "--json").out)
    assert {**found, "planning_s": 0} == {**again, "planning_s": 0}


def test_the_plan_is_that_of_the_python_interface(skyway):
    from datetime import datetime

    import skyway as library
    from skyway.planner.evaluation.evaluate import evaluate
    from skyway.planner.evaluation.realizations import held_out_forecast, sample_realizations, season_days

    scenario = library.read_scenario(library.NEW_YORK)
    state = library.State(datetime.fromisoformat("2013-07-10T14:00-04:00"), "bellevue")
    request = library.Request(state=state, destination="jacobi", payload_kg=0.8, drone="m200")
    days = season_days(scenario, request, 4)
    result = library.plan(scenario, request, forecast=held_out_forecast(scenario, request, days))
    wanted = evaluate(result, sample_realizations(scenario, request, days, runs=200))
    found = json.loads(skyway(*REQUEST, "--runs", "200", "--json").out)
    assert found["mean_s"]["value"] == pytest.approx(wanted.mean_s.value)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (
            ["--planner", "exact"],
            "--planner: has perfect information, which no forecast gives (got 'exact'); one of robust, ",
        ),
        (["--planner", "robst"], "--planner: no such planner (got 'robst')"),
        (["--online", "--planner", "pfs"], "--planner: --online flies the online policy, not a plan (got 'pfs')"),
        (["--runs", "3"], "--runs: too few (got '3'); at least 4: one on each day"),
        (["--days", "1"], "--days"),
        (["--runs", "0"], "--runs"),
        (["--to", "nowhere"], "--to"),
        (["--days", "60"], "(got '60'); hold out fewer days: "),
    ],
)
def test_a_wrong_option_is_one_clear_error(skyway, more, told):
    done = skyway(*REQUEST, *more)
    assert done.code == 2
    assert told in done.err
    assert "Traceback" not in done.err


def test_the_file_of_a_plan_is_told_from_a_scenario(skyway):
    done = skyway("evaluate", "plan.json")
    assert done.code == 2
    assert "plan.json: is not a scenario; evaluate plans the request itself: --from, --to, --payload" in done.err
