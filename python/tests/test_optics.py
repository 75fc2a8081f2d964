# SPDX-License-Identifier: MIT
import math

import numpy as np
import pytest

import pellucid
from pellucid import ffi, lib

MARBLE = pellucid.Medium.material("marble")
R = np.array([0.01, 0.1, 0.5, 1.0, 3.0, 10.0])


@pytest.mark.parametrize("model", pellucid.models())
def test_profiles_are_those_of_the_program(program, model):
    printed = program.json("profile", "wholemilk", "--model", model)
    profiles = pellucid.profiles(pellucid.Medium.material("wholemilk"), model)
    for channel, profile in zip(printed["channels"], profiles):
        # The program prints nine digits.
        assert channel["R"] == pytest.approx(profile(channel["r_mm"]), rel=1e-6)
        assert channel["rd_total"] == pytest.approx(profile.total, rel=1e-8)


def test_a_fit_is_that_of_the_program(program):
    printed = program.json("profile", "marble", "--model", "dipole", "--gaussians", "4", "--shared")
    fit = pellucid.fit(MARBLE, 4)
    for c, channel in enumerate(printed["channels"]):
        assert [g["variance_mm2"] for g in channel["fit"]["gaussians"]] == pytest.approx(fit.variance, rel=1e-8)
        assert [g["weight"] for g in channel["fit"]["gaussians"]] == pytest.approx(fit.weight[:, c], rel=1e-8)
    assert fit.total == pytest.approx([p.total for p in pellucid.profiles(MARBLE)], rel=1e-12)
    assert (fit.error < 0.05).all()


def test_arrays_give_the_bits_of_single_calls():
    a, s, eta = np.array([[0.001], [0.1]]), np.array([1.0, 2.0, 3.0]), 1.4
    for model in ("dipole", "better-dipole"):
        many = pellucid.profile_at(R, a, s, eta=eta, model=model)
        totals = pellucid.total_reflectance(a, s, eta=eta, model=model)
        assert many.shape == (2, 3, R.size) and totals.shape == (2, 3)
        for i in range(2):
            for j in range(3):
                if model == "dipole":
                    d = lib.pell_dipole_make(a[i, 0], s[j], eta, lib.PELL_FRESNEL_EXACT)
                    d = ffi.new("struct pell_dipole *", d)
                    assert many[i, j].tolist() == [lib.pell_dipole_rd(d, r) for r in R]
                    assert totals[i, j] == lib.pell_dipole_total(d)
                else:
                    p = pellucid.Profile(pellucid.Medium(a[i, 0], s[j], eta=eta), 0, model)
                    assert many[i, j].tolist() == [lib.pell_profile_eval(p.c, r) for r in R]
                    assert totals[i, j] == p.total


def test_a_number_gives_a_number():
    assert pellucid.total_reflectance(0.01, 2.0).shape == ()
    profile = pellucid.Profile(MARBLE)
    assert isinstance(profile(1.0), float) and profile(1.0) == lib.pell_profile_eval(profile.c, 1.0)


def test_samples_follow_the_profile():
    profile = pellucid.Profile(MARBLE, 1)
    xi = np.linspace(0, 0.999, 200)
    assert profile.cdf(profile.sample(xi)) == pytest.approx(xi, abs=1e-9)
    assert profile.pdf(R) * profile.total == pytest.approx(profile(R), rel=1e-12)
    assert profile.transform(0.0) == pytest.approx(profile.total, rel=1e-9)
    radii = pellucid.sample_radii(xi, MARBLE.sigma_a[1], MARBLE.sigma_s_reduced[1], eta=MARBLE.eta)
    d = ffi.new("struct pell_dipole *", lib.pell_dipole_make(MARBLE.sigma_a[1], MARBLE.sigma_s_reduced[1], MARBLE.eta, 0))
    assert radii.tolist() == [lib.pell_dipole_sample_one(d, x) for x in xi]


def test_strided_and_integer_arrays_are_read_right():
    profile = pellucid.Profile(MARBLE)
    grid = np.arange(12.0).reshape(3, 4).T
    assert profile(grid).shape == (4, 3) and (profile(grid) == profile(grid.copy())).all()
    assert profile([1, 2]).tolist() == profile([1.0, 2.0]).tolist()


def test_colours_and_albedos_are_inverse():
    color = np.array([0.1, 0.5, 0.8])
    albedo = pellucid.albedo_from_color(color, model="better-dipole", eta=1.3)
    assert pellucid.total_reflectance(1 - albedo, albedo, eta=1.3, model="better-dipole") == pytest.approx(color, abs=1e-8)
    for name in ("van-de-hulst", "chiang", "dipole"):
        assert pellucid.color_from_albedo(pellucid.albedo_from_color(color, map=name), map=name) == pytest.approx(color, abs=1e-6)
    medium = pellucid.Medium.from_color(color, 2.0, kind="diffuse", eta=1.3)
    assert medium.diffuse_mean_free_path == pytest.approx([2.0] * 3)
    assert [p.total for p in pellucid.profiles(medium)] == pytest.approx(color, abs=1e-8)


def test_kernels():
    skin = pellucid.skin_layers(melanin=0.03).profiles()
    kernel = pellucid.separable(skin, taps=17, rank=2)
    sums = (kernel.sign * kernel.weight.sum(axis=1) ** 2).sum(axis=0)
    assert sums == pytest.approx(kernel.total) and kernel.total == pytest.approx([p.total for p in skin], rel=1e-6)
    offset, weight = pellucid.gaussian_taps(0.5, 9)
    assert weight.sum() == pytest.approx(1) and (weight * offset ** 2).sum() == pytest.approx(0.5)
    step, blend, total = pellucid.chain(pellucid.fit(MARBLE, 3))
    assert step.sum() == pytest.approx(pellucid.fit(MARBLE, 3).variance[-1]) and (blend[0] == 1).all() and total.shape == (3,)
    ring = pellucid.table_ring(skin[0], 3.0, 32)
    assert ring.sum() == pytest.approx(skin[0].total * skin[0].cdf(3.0), rel=1e-5)
    assert pellucid.table_value(skin[0], 3.0, 32).shape == (32,)
    assert (np.diff(pellucid.table_radius(skin[0], 16)) > 0).all()
    assert pellucid.table_sphere(skin[0], 0.5, 8, 4).shape == (4, 8)


def test_stacks_conserve_energy_and_match_their_profiles():
    clear = pellucid.Medium(0.0, 2.0, eta=1.0)
    stack = pellucid.Stack([pellucid.Layer(clear, 1.0), pellucid.Layer(clear, 2.0)])
    totals = stack.totals()
    assert totals[0] + totals[1] == pytest.approx([1, 1, 1], abs=1e-6)
    assert stack.profile("T+").total == pytest.approx(totals[1, 0], rel=1e-6)
    parts = stack(R, 2)
    assert parts.shape == (4, R.size) and parts[0] == pytest.approx(stack.profile("R+", 2)(R), rel=1e-4)
    assert stack.transforms(0.0) == pytest.approx(totals[:, 0], rel=1e-6)


def test_phases_integrate_to_one():
    mu = np.linspace(-1, 1, 20001)
    for phase in (pellucid.Phase(g=0.3), pellucid.Phase("schlick", 0.4), pellucid.Phase("rayleigh"), pellucid.Phase("two-lobe", (0.8, -0.2), 0.7)):
        assert 2 * math.pi * np.trapz(phase(mu), mu) == pytest.approx(1, abs=1e-5)
    assert pellucid.Phase(g=0.3).mean_cosine == pytest.approx(0.3)


def test_tables_are_profiles():
    r = np.linspace(0, 5, 200)
    table = pellucid.Profile.table(r, 0.1 * np.exp(-r))
    assert table.total == pytest.approx(0.2 * math.pi * (1 - 6 * math.exp(-5)), rel=1e-3)
    with pytest.raises(pellucid.InvalidError, match="row"):
        pellucid.Profile.table(r, np.full(200, 5.0))


def test_errors_say_place_value_and_remedy():
    with pytest.raises(pellucid.InvalidError) as e:
        pellucid.Medium((0.1, -0.5, 0.1), 1.0)
    assert e.value.where == "sigma_a[1]" and "-0.5" in e.value.what and isinstance(e.value, ValueError)
    assert e.value.function == "Medium" and str(e.value).startswith("Medium: sigma_a[1] is -0.5, must be in [0, ")
    with pytest.raises(pellucid.InvalidError, match='did you mean "wholemilk"'):
        pellucid.Medium.material("wholemilc")
    with pytest.raises(pellucid.InvalidError, match="better-dipole"):
        pellucid.Profile(MARBLE, 0, "beter-dipole")
    with pytest.raises(pellucid.InvalidError, match=r"medium \[1\]"):
        pellucid.profile_at(R, [0.1, np.nan], 1.0)
    layer = pellucid.Layer(MARBLE, 1.0)
    for call, said in (
            (lambda: pellucid.fit(MARBLE, 11), "fit: count is 11, must be in [1, 10]"),
            (lambda: pellucid.fit(MARBLE, 2.5), "fit: count is 2.5, must be a whole number in [1, 10]"),
            (lambda: pellucid.fit(MARBLE, r_max=-1), "fit: r_max is -1, must be a length in mm"),
            (lambda: pellucid.Profile(MARBLE, 3), "Profile: channel is 3, must be 0, 1 or 2"),
            (lambda: pellucid.Profile("marble"), "Profile: medium is 'marble', must be a Medium"),
            (lambda: pellucid.Profile.table([1, 2], [1]), "Profile.table: r has the shape (2,) and R (1,), both must have one (n,)"),
            (lambda: pellucid.Profile(MARBLE, roughness=4), "Profile: roughness is 4, must be in [0, 1]"),
            (lambda: pellucid.profile_at(R, 1, 1, rougness=1), 'profile_at: there is no parameter "rougness" (did you mean "roughness"?)'),
            (lambda: pellucid.gaussian_taps(-1.0), "gaussian_taps: variance is -1.0, must be above 0 and finite"),
            (lambda: pellucid.gaussian_taps(1.0, 8), "gaussian_taps: taps is 8, must be odd, 3 to 65"),
            (lambda: pellucid.fit(MARBLE)(R, 3), "Gaussians: channel is 3, must be 0, 1 or 2"),
            (lambda: pellucid.Gaussians([1], [[1, 1]]), "Gaussians: variance has the shape (1,) and weight (1, 2), must have (n,) and (n, 3)"),
            (lambda: pellucid.Medium("x", 1), "Medium: sigma_a must be numbers: "),
            (lambda: pellucid.Medium(1), "Medium: sigma_s_reduced is missing: give it, or sigma_s"),
            (lambda: pellucid.Medium(1, 1, sigma_s=1), "Medium: sigma_s is given beside sigma_s_reduced, must be left out"),
            (lambda: pellucid.Medium((1, 2), 1), "Medium: sigma_a has the shape (2,), must be one number or three"),
            (lambda: pellucid.Medium.material("skin-6gaussian"), 'Medium.material: name is "skin-6gaussian", a material without'),
            (lambda: pellucid.Stack([]), "Stack: layers has 0, must have 1 to 32"),
            (lambda: pellucid.Stack([layer], roughness=[0, 0, 0]), "Stack: roughness has the shape (3,), must be one number or 2"),
            (lambda: pellucid.Stack([layer]).profile("R"), 'Stack.profile: there is no part "R" (did you mean "R'),
            (lambda: pellucid.Stack([layer]).transforms(-1), "Stack.transforms: s is -1, must be a frequency of 0 or more"),
            (lambda: pellucid.skin_color(melanine=1), 'skin_color: skin has no member "melanine" (did you mean "melanin"?)'),
            (lambda: pellucid.skin_color(melanin=2), "skin_color: melanin is 2, must be in ["),
            (lambda: pellucid.Phase(g=2), "Phase: g[0] is 2, must be in ["),
            (lambda: pellucid.Phase("mie"), 'Phase: there is no kind "mie"; there are henyey-greenstein, schlick'),
            (lambda: pellucid.fresnel([1.3, 1.4], [1, 1, 1]),
             "fresnel: the shapes of the arguments do not go together, must broadcast: eta (2,), cos_i (3,)"),
            (lambda: pellucid.separable([pellucid.Profile(MARBLE)]), "separable: profiles has 1, must have three (R, G, B)"),
            (lambda: pellucid.separable(pellucid.profiles(MARBLE), rank=4), "separable: rank is 4, must be in [1, 3]"),
            (lambda: pellucid.table_value(pellucid.Profile(MARBLE), 0.0, 8), "table_value: r_max is 0.0, must be above 0 and finite")):
        with pytest.raises(pellucid.InvalidError) as e:
            call()
        assert str(e.value).startswith(said), str(e.value)


def test_a_near_name_comes_without_the_list_and_exceptions_are_the_packages():
    with pytest.raises(pellucid.InvalidError) as e:
        pellucid.Medium.material("marbel")
    assert str(e.value) == 'Medium.material: there is no material "marbel" (did you mean "marble"?)'
    with pytest.raises(pellucid.InvalidError, match="there are .*marble"):
        pellucid.Medium.material("xyzzy")
    for name in pellucid.__all__:
        made = getattr(pellucid, name)
        if isinstance(made, type) and issubclass(made, (Exception, Warning)):
            assert made.__module__ == "pellucid"


def test_every_material_is_readable():
    for name in pellucid.materials():
        entry = pellucid.material(name)
        assert entry["medium"] or entry["gaussians"]
