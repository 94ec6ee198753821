"""A finding that somebody accepts is in the equation of the next iterations, and out of it when it is revoked."""

import hashlib
import itertools
import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from plain_parts import parts as made_up
from written_diagnosis import diagnosis, term_of

from pido import accepted, config, plain
from pido.core.columns import INPUTS
from pido.core.errors import DiagnosisError, RegistryError
from pido.core.samples import Samples
from pido.diagnosis.mechanisms import CATALOGUE
from pido.equations.choose import EVERYWHERE, Candidate, Choice, candidates, choose
from pido.equations.fit import fit_global, fit_global_from, fit_local
from pido.equations.moments import Moments
from pido.equations.terms import HELD, PAPER
from pido.feature_space.density import relevant_bins
from pido.feature_space.grid import EQUATION_GRID
from pido.files import equations as equation_files
from pido.iteration import Recipe, physics, refit
from pido.physics_journal import journal, outcome
from pido.recordings.folder import write_folder
from pido.sampling.method import PAPER_METHOD
from pido.supervision.part import Expectation
from pido.tracking import promotion
from pido.tracking.ledger import Ledger
from pido.tracking.mlflow_store import client, experiment, model_names
from pido.tracking.promotion import TOKEN
from pido.workspace import Workspace

MACHINE = config.machine("dmc60h")


def rows(n=1500, seed=0):
    """x moves back and forth; its current is Coulomb friction and 0.3 A of Stribeck friction with v_s = 2 mm/s."""
    rng = np.random.default_rng(seed)
    inputs = np.zeros((n, len(INPUTS)))
    inputs[:, 0], inputs[:, 1] = rng.uniform(-12, 12, n), rng.uniform(-12, 12, n)
    inputs[:, :2] += 0.1 * np.sign(inputs[:, :2])  # the axis moves: within its dead band it would stand still
    direction = np.zeros((n, 4))
    direction[:, :2] = np.sign(inputs[:, :2])
    currents = rng.normal(0, 0.01, (n, 4))
    currents[:, 0] += (0.5 + 0.3 * np.exp(-((inputs[:, 0] / 2.0) ** 2))) * direction[:, 0]
    return Samples.real(inputs, np.zeros(n), currents, direction, "p", np.arange(n))


def test_an_accepted_finding_is_fitted_with_its_true_amplitude(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d"), 1, by="A", reason="seen")
    (extended,) = accepted.term_sets(accepted.terms(place, MACHINE), adaptive=False)
    plain, better = (fit_global(rows(), MACHINE, t).predict(rows(seed=1))[:, 0] for t in (PAPER, extended))
    truth = rows(seed=1).currents[:, 0]
    assert np.sqrt(np.mean((truth - better) ** 2)) < 0.011 < 0.04 < np.sqrt(np.mean((truth - plain) ** 2))


@pytest.mark.parametrize("recipe", [Recipe(), Recipe(PAPER_METHOD)], ids=["adaptive", "paper"])
def test_the_next_iteration_chooses_the_extended_equation_and_its_file_reads_back(tmp_path, recipe):
    place = Workspace.open(tmp_path / "plant")
    accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d"), 1, by="A", reason="seen")
    own = accepted.terms(place, MACHINE)
    plainly, recipe = recipe, Recipe(recipe.method, extended=accepted.term_sets(own, recipe.method.adaptive))
    found = refit(rows(600), MACHINE, recipe, 0)
    assert own[0][0].name in found.choice.near[0].terms.id
    assert found.choice.near[1:] == refit(rows(600), MACHINE, plainly, 0).choice.near[1:]
    again = equation_files.load(equation_files.dump(found), MACHINE, own)
    assert again.choice.near == found.choice.near


def test_true_physics_makes_no_equation_worse_whichever_of_the_shipped_ones_the_axis_needs(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    side = {"side": 2.0, "back": 0.0, "rest": 3.0, "v_0": 3.0}
    folder = diagnosis(tmp_path / "d", "friction_asymmetry", shape=side, amplitudes=2)
    accepted.accept(place, MACHINE.id, folder, 1, by="A", reason="seen")
    own = accepted.terms(place, MACHINE)
    samples = rows(1000)
    v = samples.inputs[:, 0]
    friction = 0.5 - 0.5 * np.exp(-(v**2))  # goes to zero with the speed, for which only the richest equation has terms
    asymmetry = 0.3 * np.tanh(np.minimum(v, 0.0) / 3.0)
    samples.currents[:, 0] = friction * np.sign(v) + asymmetry + np.random.default_rng(1).normal(0, 0.01, len(v))
    choice = choose(samples, MACHINE, candidates(*accepted.term_sets(own, adaptive=True)))
    found = physics(choice, [term for term, _ in own])["held_out"]["x"]
    assert found["with"] < 0.9 * found["without"]
    assert own[0][0] in choice.near[0].terms.extras


def test_a_law_whose_numbers_are_large_is_fitted_beside_small_ones():
    found = {**term_of("spindle_windage", {}), "amplitudes": [1e-9]}
    term, size = accepted.as_term("sp windage", "sp", found, MACHINE)
    samples = rows(600)
    speed = np.linspace(0.0, MACHINE.spindle_max_deg_s, len(samples))
    samples.inputs[:, INPUTS.index("v_sp")] = speed
    samples.direction[:, 3] = 1.0
    samples.currents[:, 3] += 2e-9 * speed**2  # 4.6 A at 48 000 deg/s
    extended = HELD.extended(term, size)
    moments = Moments(extended, MACHINE)
    moments.add(samples)
    for fitted in (fit_global(samples, MACHINE, extended), fit_global_from(moments)):
        assert fitted.coefficients[3, -1] / term.reach[0] == pytest.approx(2e-9, rel=0.01)


@pytest.mark.parametrize("name", ["friction_asymmetry", "miscalibrated:friction_asymmetry"])
def test_where_no_row_shows_it_a_finding_has_the_size_at_which_it_was_found(name):
    side = {"side": 2.0, "back": 0.0, "rest": 0.0, "v_0": 0.1}
    term, size = accepted.as_term("x friction", "x", term_of(name, side, 2), MACHINE)  # 0.3 A and 0.3 A/(mm/s)
    extended = HELD.extended(term, size)
    samples, unseen = rows(600), rows(600, seed=1)
    forth, back = samples.take(samples.inputs[:, 0] > 0), unseen.take(unseen.inputs[:, 0] < 0)
    moments = Moments(extended, MACHINE)
    moments.add(forth)
    bins = relevant_bins(np.vstack([forth.reduced, back.reduced]), EQUATION_GRID)
    missing = 0.3 + 0.3 * np.abs(back.inputs[:, 0]) if name == "friction_asymmetry" else 0.0
    one, each = (fit_global(forth, MACHINE, HELD), fit_local(forth, bins, MACHINE, terms=HELD))
    for without, fitted in (
        (one, fit_global(forth, MACHINE, extended)),
        (one, fit_global_from(moments)),
        (each, fit_local(forth, bins, MACHINE, terms=extended)),
    ):
        np.testing.assert_allclose(fitted.predict(forth), without.predict(forth), atol=1e-6)
        change = fitted.predict(back) - without.predict(back)
        np.testing.assert_allclose(change[:, 0], -missing, atol=1e-6)
        np.testing.assert_allclose(change[:, 1:], 0.0, atol=1e-9)


@pytest.mark.parametrize("mechanism", [m for m in CATALOGUE if m.id in accepted.INSTANT], ids=lambda m: m.id)
def test_every_form_of_every_mechanism_that_may_be_accepted_has_columns_for_rows(mechanism):
    samples = rows(50)
    points = [dict(zip([p.name for p in mechanism.shape], values, strict=True))
              for values in itertools.product(*(p.values or (1.0,) for p in mechanism.shape))]  # fmt: skip
    for shape in points:
        term, size = accepted.as_term("x", "x", term_of(mechanism.id, shape, len(mechanism.amplitudes)), MACHINE)
        columns = term.columns(samples)
        assert columns.shape == (len(samples), size)
        assert np.isfinite(columns).all()


@pytest.mark.parametrize(
    ("axis", "mechanism", "shape", "by"),
    [
        ("x", "miscalibrated:viscous_friction", {}, "v_x"),
        ("sp", "spindle_inertia", {}, "a_sp"),
        ("y", "coulomb_friction", {"rest": 1.0, "v_0": 0.1}, r"held\(v_y\)"),
        ("x", "axis_coupling", {"source": 4.0}, "v_y"),
    ],
)
def test_what_the_equation_is_made_of_is_not_accepted_into_it(tmp_path, axis, mechanism, shape, by):
    place = Workspace.open(tmp_path / "plant")
    folder = diagnosis(tmp_path / "d", mechanism, shape=shape, axis=axis)
    with pytest.raises(DiagnosisError, match=rf"{axis} {mechanism} is in the equation already, by {by}\. .*correct"):
        accepted.accept(place, MACHINE.id, folder, 1, by="A", reason="seen")
    assert journal(place, MACHINE.id) == []
    printed = Workspace.open(tmp_path / "printed", method="paper")  # these 17 terms are others
    assert accepted.accept(printed, MACHINE.id, folder, 1, by="A", reason="seen").action == "accept"


def test_what_only_some_parts_cannot_tell_from_the_equation_is_accepted(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    gate = {"variable": "v_x", "low": 0.0, "high": 5.0}
    for k, (mechanism, gates) in enumerate([("viscous_friction", [gate]), ("coulomb_friction", [])]):
        shape = {} if gates else {"rest": 0.0, "v_0": 0.1}
        folder = diagnosis(tmp_path / f"d{k}", mechanism, shape=shape, gates=gates)
        accepted.accept(place, MACHINE.id, folder, 1, by="A", reason="seen")
    both = diagnosis(tmp_path / "both", "standstill_friction", shape={"rest": 0.0})
    with pytest.raises(DiagnosisError, match=r"by held\(v_x\), x coulomb_friction"):  # the one less the other
        accepted.accept(place, MACHINE.id, both, 1, by="A", reason="seen")


def test_the_same_physics_is_in_force_once_per_axis(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    old = accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d1"), 1, by="A", reason="seen")
    again = diagnosis(tmp_path / "d2", shape={"v_s": 3.0, "delta": 1.0})
    with pytest.raises(DiagnosisError, match=rf"in force already, as {old.id} .*--revoke {old.id} --by"):
        accepted.accept(place, MACHINE.id, again, 1, by="A", reason="seen")
    other = diagnosis(tmp_path / "d3", axis="y")
    assert accepted.accept(place, MACHINE.id, other, 1, by="A", reason="seen").axis == "y"
    accepted.revoke(place, MACHINE.id, old.id, by="A", reason="the new one fits better")
    accepted.accept(place, MACHINE.id, again, 1, by="A", reason="seen")
    assert [term.name.split()[:2] for term, _ in accepted.terms(place, MACHINE)] == [
        ["y", "stribeck_friction"], ["x", "stribeck_friction"],
    ]  # fmt: skip


def test_a_state_is_known_by_the_physics_in_force(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    before = place.run_key(MACHINE.id, ["p"])
    entry = accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d"), 1, by="A", reason="seen")
    with_it = place.run_key(MACHINE.id, ["p"])
    accepted.revoke(place, MACHINE.id, entry.id, by="A", reason="guideway replaced")
    assert with_it != before == place.run_key(MACHINE.id, ["p"])
    assert place.run_key("another", ["p"]) != before
    assert [(e.version, e.action) for e in journal(place, MACHINE.id)] == [(1, "accept"), (2, "revoke")]
    assert accepted.terms(place, MACHINE) == ()


def test_the_same_finding_is_not_accepted_twice_and_the_refusal_writes_nothing(tmp_path):
    place, folder = Workspace.open(tmp_path / "plant"), diagnosis(tmp_path / "d")
    entry = accepted.accept(place, MACHINE.id, folder, 1, by="A. Ito", reason="seen")
    written = place.physics_journal(MACHINE.id).read_bytes()
    with pytest.raises(DiagnosisError, match=rf"in force already, as {entry.id}: .* by A\. Ito on {entry.at[:10]}"):
        accepted.accept(place, MACHINE.id, folder, 1, by="B", reason="again")
    assert place.physics_journal(MACHINE.id).read_bytes() == written
    accepted.revoke(place, MACHINE.id, entry.id, by="A. Ito", reason="an exercise")
    assert accepted.accept(place, MACHINE.id, folder, 1, by="B", reason="after all").id == entry.id


@pytest.mark.parametrize("change", ["edit", "remove", "remove the last", "swap", "remove all"])
def test_a_journal_that_was_changed_by_hand_is_found_and_one_without_a_seal_is_read(tmp_path, change):
    place = Workspace.open(tmp_path / "plant")
    entry = accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d"), 1, by="A", reason="seen")
    path = place.physics_journal(MACHINE.id)
    path.with_suffix(".head.json").unlink()  # as older versions left it
    accepted.revoke(place, MACHINE.id, entry.id, by="A", reason="guideway replaced")
    lines = path.read_text().splitlines(keepends=True)
    changed = {
        "edit": [lines[0].replace("seen", "unseen"), lines[1]],
        "remove": lines[1:],
        "remove the last": lines[:1],
        "swap": lines[::-1],
        "remove all": [],
    }
    path.write_text("".join(changed[change]))
    with pytest.raises(RegistryError, match="changed outside the tool"):
        accepted.terms(place, MACHINE)
    path.write_text("".join(lines))
    assert accepted.terms(place, MACHINE) == ()


@pytest.mark.parametrize(
    ("about", "says"),
    [
        ({"mechanism": "thermal_drift", "shape": {}}, "how long the machine has been running.*pido correct"),
        ({"mechanism": "sensor_gain", "kind": "data_fault", "shape": {}}, "fault of the data"),
    ],
)
def test_what_rows_cannot_know_or_is_no_physics_is_refused_with_a_way_out(tmp_path, about, says):
    place = Workspace.open(tmp_path / "plant")
    with pytest.raises(DiagnosisError, match=says):
        accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d", **about), 1, by="A", reason="r")
    with pytest.raises(DiagnosisError, match=r"no finding 2.*1 x:stribeck_friction"):
        accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d"), 2, by="A", reason="r")
    with pytest.raises(RegistryError, match="in force: nothing"):
        accepted.revoke(place, MACHINE.id, "00", by="A", reason="r")


def test_a_finding_is_named_by_axis_and_mechanism_where_the_next_parts_take_its_place(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    newest = diagnosis(place.diagnosis(MACHINE.id))
    with pytest.raises(DiagnosisError, match="--finding x:stribeck_friction"):
        accepted.accept(place, MACHINE.id, newest, 1, by="A", reason="seen")
    read = "x:stribeck_friction"
    assert accepted.accept(place, MACHINE.id, newest, read, by="A", reason="seen").mechanism == "stribeck_friction"
    accepted.revoke(place, MACHINE.id, journal(place, MACHINE.id)[0].id, by="A", reason="an exercise")
    diagnosis(newest, "viscous_friction", shape={})  # the next part came
    with pytest.raises(DiagnosisError, match=r"no finding x:stribeck_friction.*1 x:viscous_friction"):
        accepted.accept(place, MACHINE.id, newest, read, by="A", reason="seen")


def test_what_was_found_on_one_machine_does_not_extend_the_equation_of_another(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    with pytest.raises(DiagnosisError, match="of machine 'the other one', not of 'dmc60h'"):
        accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d", machine="the other one"), 1, by="A", reason="seen")
    accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d", machine=MACHINE.id), 1, by="A", reason="seen")


def test_what_a_page_offers_is_what_is_accepted_and_the_rest_has_its_reason(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    for k, mechanism in enumerate(("stribeck_friction", "inertia", "backlash", "thermal_drift", "sensor_gain")):
        kind = "data_fault" if mechanism == "sensor_gain" else "missing_physics"
        folder = diagnosis(tmp_path / str(k), mechanism, kind, {} if k else None, axis="y")
        model = json.loads((folder / "model.json").read_text())
        offered = accepted.offers([("y", mechanism, kind)], model)
        assert [name for name, _ in offered] == [f"y:{mechanism}"] * (kind != "data_fault")
        if [why for _, why in offered] == [""]:
            assert accepted.accept(place, MACHINE.id, folder, 1, by="A", reason="seen").mechanism == mechanism
            continue
        with pytest.raises(DiagnosisError, match=re.escape(offered[0][1]) if offered else "fault of the data"):
            accepted.accept(place, MACHINE.id, folder, 1, by="A", reason="seen")
    assert [e.mechanism for e in journal(place, MACHINE.id)] == ["stribeck_friction"]


def test_a_law_that_stands_on_an_axis_twice_is_not_accepted_by_chance(tmp_path):
    place, folder = Workspace.open(tmp_path / "plant"), diagnosis(tmp_path / "d")
    model = json.loads((folder / "model.json").read_text())
    model["axes"]["x"]["terms"] *= 2
    (folder / "model.json").write_text(json.dumps(model))
    with pytest.raises(DiagnosisError, match="stands there 2 times"):
        accepted.accept(place, MACHINE.id, folder, 1, by="A", reason="seen")


def test_who_decides_has_a_name_and_the_credential_that_approval_asks_for(tmp_path, monkeypatch):
    place = Workspace.open(tmp_path / "plant", approval_token_sha256=hashlib.sha256(b"secret").hexdigest())
    for by, token in (("", "secret"), ("A", ""), ("A", "guessed")):
        monkeypatch.setenv(TOKEN, token)
        with pytest.raises(RegistryError, match=r"--by|credential"):
            accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d"), 1, by=by, reason="seen")
    assert journal(place, MACHINE.id) == []
    monkeypatch.setenv(TOKEN, "secret")
    entry = accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d"), 1, by="A", reason="seen")
    monkeypatch.setenv(TOKEN, "")
    with pytest.raises(RegistryError, match="credential"):
        accepted.revoke(place, MACHINE.id, entry.id, by="A", reason="seen")


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (
            0.0804,
            r"off by 0\.0804 A with it and by 0\.0782 A without: it makes the equation worse \(\+2\.8%\).*--revoke",
        ),
        (0.0780, r"changes little \(-0\.3%\)"),
        (0.0391, r"helps \(-50\.0%\)"),
    ],
)
def test_what_accepted_physics_brings_is_said_in_words_and_that_it_loses_too(tmp_path, error, says):
    place = Workspace.open(tmp_path / "plant")
    entry = accepted.accept(place, MACHINE.id, diagnosis(tmp_path / "d"), 1, by="A", reason="seen")
    ((term, size),) = accepted.terms(place, MACHINE)
    tried = tuple(Candidate(terms, EVERYWHERE) for terms in (HELD, HELD.extended(term, size)))
    scores = np.full((2, 2, 4), np.nan)
    scores[0, :, 0], scores[0, 0, 1:] = (0.0782, error), 0.1
    best = tried[int(error < 0.07)]
    choice = Choice((best, *[tried[0]] * 3), (tried[0],) * 4, None, scores, tuple(map(str, tried)))
    found = physics(choice, [term])
    assert found["held_out"] == {"x": {"without": 0.0782, "with": error}}
    (words,) = found["words"]
    stands = outcome(entry, 7, found)  # `pido status` tells the same
    assert ("does without it" in stands) == ("does without" in words)
    assert ("x stribeck_friction extends the equation of version 7" in stands) == (error < 0.07)
    assert f"{error:.3g} A with it, 0.0782 A without" in stands
    assert "next iteration" in outcome(entry, 7, physics(choice, []))
    assert re.search(f"x stribeck_friction {entry.id}.*{says}", words)
    assert ("the equation chosen does without" in words) == (error > 0.07)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::ResourceWarning")
def test_a_run_says_with_which_accepted_physics_it_was_trained_and_what_that_brought(tmp_path):
    from pido.cli.iterate import command
    from pido.cli.status import command as status

    (tmp_path / "plant").mkdir()
    (tmp_path / "plant" / "workspace.toml").write_text("compare = false\n[method]\ncompare_with_model = false\n")
    place = Workspace.open(tmp_path / "plant")
    part = next(made_up(1)).rows(slice(0, 600))
    plain.run(place, [write_folder(part, tmp_path / "given" / "p")], None, lambda *a: None)
    entry = accepted.accept(place, "cmx600v", diagnosis(tmp_path / "d"), 1, by="A", reason="seen")
    shown = CliRunner().invoke(command, ["--workspace", str(place.root)])
    assert shown.exit_code == 0
    with client(place) as store:
        runs = store.search_runs([experiment(place, store, "cmx600v")], order_by=["attributes.start_time"])
    assert [run.data.tags["pido.physics"] for run in runs] == ["none", f"x stribeck_friction {entry.id}"]
    line = f"Accepted physics of x stribeck_friction {entry.id}: on rows held out"
    assert line in shown.output
    stands = CliRunner().invoke(status, ["--workspace", str(place.root)]).output
    assert ("equation of version 1 does without it" in stands) == ("chosen does without" in shown.output)
    assert ("extends the equation of version 1" in stands) == ("chosen does without" not in shown.output)
    assert [line in run.data.tags["mlflow.note.content"] for run in runs] == [False, True]
    assert {"accepted_physics_x/with", "accepted_physics_x/without"} <= set(runs[1].data.metrics)
    assert not any(name.startswith("accepted_physics_y") for name in runs[1].data.metrics)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::ResourceWarning")
def test_what_was_trained_with_physics_that_is_revoked_waits_no_longer_and_does_not_go_into_force(tmp_path):
    (tmp_path / "plant").mkdir()
    (tmp_path / "plant" / "workspace.toml").write_text(
        "compare = false\n[method]\nadaptive = false\ncompare_with_model = false\n"
    )
    place, who = Workspace.open(tmp_path / "plant"), {"by": "A", "reason": "seen"}
    part = next(made_up(1)).rows(slice(0, 600))
    plain.run(place, [write_folder(part, tmp_path / "given" / "p")], None, lambda *a: None)
    entry = accepted.accept(place, "cmx600v", diagnosis(tmp_path / "d"), 1, **who)

    def retrained():
        """Versions that are new, what became of all, and by which one a part would be judged."""
        new = [one["version"] for one in plain.retrain_all(place, lambda *a: None)["done"]]
        states = [standing.state for standing in promotion.standings(place, "cmx600v")]
        return new, states, Expectation.of(place, "cmx600v").model

    assert retrained() == ([2], ["superseded", "challenger"], "challenger version 2")
    accepted.revoke(place, "cmx600v", entry.id, by="A", reason="wrong")
    assert retrained() == ([], ["challenger", "superseded"], "challenger version 1")
    with client(place) as store:
        for name in model_names("cmx600v").values():
            assert store.get_model_version_by_alias(name, "challenger").tags["pido.version"] == "1"
    Ledger(place.ledger).judged("cmx600v", 2, {"passed": True, "words": "set by this test"})
    with pytest.raises(RegistryError, match=f"physics that is revoked: x stribeck_friction {entry.id}. `pido iterate`"):
        promotion.approve(place, "cmx600v", 2, **who)
    accepted.accept(place, "cmx600v", tmp_path / "d", 1, **who)
    assert promotion.approve(place, "cmx600v", 2, **who).version == 2
