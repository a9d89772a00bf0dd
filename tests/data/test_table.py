"""Tables of one's own: the same numbers from every way to write them; anything else is named by line and column."""

from __future__ import annotations

import codecs
import re

import numpy as np
import pytest
import table_mutations
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mi_enhance import data
from mi_enhance.data import synthetic


@pytest.fixture
def some():
    return synthetic.ggx_anisotropic(3, n_samples=300)[0]


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_round_trip_is_exact(some, tmp_path, suffix):
    data.save_table(some, tmp_path / f"t{suffix}")
    back = data.load(tmp_path / f"t{suffix}")
    assert back.name == "t" and all(np.array_equal(getattr(back, k), getattr(some, k)) for k in ("wi", "wo", "f"))
    assert len(list(tmp_path.iterdir())) == 1  # no temporary file stays


def test_failed_write_keeps_the_old_file(some, tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    data.save_table(some, path)
    before = path.read_bytes()
    monkeypatch.setattr(np, "savetxt", lambda name, *args, **kw: (open(name, "w").close(), 1 / 0))
    with pytest.raises(ZeroDivisionError):
        data.save_table(some, path)
    assert path.read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_angles_and_grey(tmp_path):
    (tmp_path / "a.csv").write_text(
        "f,theta_o,phi_o,theta_i,phi_i\n0.25,0.5,1.0,0.2,0\n-0.5,0.1,0,0.1,0\n0.5,2.0,0,0,0\n"
    )
    m = data.load(tmp_path / "a.csv")
    assert m.f.tolist() == [[0.25] * 3, [0] * 3] and m.clamped_fraction == 0.5
    np.testing.assert_allclose(m.wi[0], (np.sin(0.2), 0, np.cos(0.2)), atol=1e-7)  # i is the viewer
    np.testing.assert_allclose(m.wo[0], [np.sin(0.5) * np.cos(1), np.sin(0.5) * np.sin(1), np.cos(0.5)], atol=1e-7)
    assert "1 rows below the horizon dropped" in m.source


def test_more_rows_than_asked_are_drawn_from(some, tmp_path):
    data.save_table(some, tmp_path / "t.npz")
    m, again, other = (data.load(tmp_path / "t.npz", n_samples=np.int64(100), seed=s) for s in (1, 1, 2))
    assert "100 of 300 rows drawn" in m.source and len(np.unique(m.wi, axis=0)) == 100
    assert np.array_equal(m.f, again.f) and not np.array_equal(m.f, other.f)


# ---- as other programs write them

RAD = "theta_i,phi_i,theta_o,phi_o,f\n0.1,0,0.5,3,0.25\n0.2,1,0.6,2,1.5\n"
ROWS = "0.1,0,0.5,3,0.25\n0.2,1,0.6,2,1.5\n"


def semicolons(text):
    return text.replace(",", ";")


SAME = {
    "semicolons": semicolons(RAD),
    "tabs": RAD.replace(",", "\t"),
    "spaces": RAD.replace(",", " "),
    "aligned": RAD.replace(",", "   ").replace("\n0", "\n   0"),
    "spaces after commas": RAD.replace(",", ", "),
    "decimal commas": semicolons(RAD).replace("0.", "0,").replace("1.", "1,"),
    "decimal commas and tabs": RAD.replace(",", "\t").replace("0.", "0,").replace("1.", "1,"),
    "quoted decimal commas": "theta_i,phi_i,theta_o,phi_o,f\n"
    + '"0,1","0","0,5","3","0,25"\n"0,2","1","0,6","2","1,5"\n',
    "header in a comment": "# " + RAD,
    "header in a comment, numbers by spaces": "# theta_i,phi_i,theta_o,phi_o,f\n" + ROWS.replace(",", " "),
    "percent": "% " + RAD,
    "slashes": "//" + RAD,
    "comments": "# measured in May\n% 23 °C\n\n" + RAD.replace("\n0.2", "\n# turned\n\n0.2"),
    "title": "Goniometer 7\nsample: paper\n" + RAD,
    "line for Excel": "sep=;\n" + semicolons(RAD),
    "remark behind a row": RAD.replace("0.25", "0.25 # weak"),
    "quoted header": '"theta_i","phi_i","theta_o","phi_o","f"\n' + ROWS,
    "capitals": "Theta_i,PHI_I,Theta_o,Phi_o,F\n" + ROWS,
    "units": "theta_i [rad],phi_i (rad),theta_o/rad,phi_o_rad,f [1/sr]\n" + ROWS,
    "line of units": "theta_i,phi_i,theta_o,phi_o,f\nrad,rad,rad,rad,1/sr\n" + ROWS,
    "separator at the end": RAD.replace("\n", ",\n"),
    "other columns": "time,theta_i,phi_i,theta_o,phi_o,f,who\n12:00,0.1,0,0.5,3,0.25,me\n12:01,0.2,1,0.6,2,1.5,\n",
    "other order": "f,phi_o,theta_o,phi_i,theta_i\n0.25,3,0.5,0,0.1\n1.5,2,0.6,1,0.2\n",
    "numbered rows": ",theta_i,phi_i,theta_o,phi_o,f\n0,0.1,0,0.5,3,0.25\n1,0.2,1,0.6,2,1.5\n",
    "comment with a value": "# angle of incidence: 45 deg\n" + RAD,
    "no line end": RAD.rstrip(),
    "old line ends": RAD.replace("\n", "\r"),
    "Windows": RAD.replace("\n", "\r\n"),
    "exponents": RAD.replace("0.25", "2.5e-1").replace("1.5", "+1.5E+00"),
}


@pytest.mark.parametrize("way", SAME)
def test_the_same_numbers_however_written(tmp_path, way):
    (tmp_path / "t.csv").write_text(SAME[way], encoding="utf-8", newline="")
    (tmp_path / "plain.csv").write_text(RAD)
    m, plain = data.load(tmp_path / "t.csv"), data.load(tmp_path / "plain.csv")
    assert all(np.array_equal(getattr(m, k), getattr(plain, k)) for k in ("wi", "wo", "f"))
    assert ("columns ignored: time, who" in m.source) == (way == "other columns")


@pytest.mark.parametrize(
    "content",
    [
        codecs.BOM_UTF8 + RAD.encode(),
        RAD.encode("utf-16"),
        codecs.BOM_UTF16_BE + RAD.encode("utf-16-be"),
        ("# 23 °C\n" + RAD).encode("latin-1"),
    ],
    ids=["utf-8 with mark", "utf-16", "utf-16 big", "latin-1"],
)
def test_encodings(tmp_path, content):
    (tmp_path / "t.csv").write_bytes(content)
    assert data.load(tmp_path / "t.csv").f[:, 0].tolist() == [0.25, 1.5]


def test_exponents_of_fortran_and_rows_of_separators(tmp_path):
    (tmp_path / "t.csv").write_text("theta_i,phi_i,theta_o,phi_o,f\n,,,,\n0.0D0,0,1.0d-1,0,2.5D+00\n , ,,,\n")
    m = data.load(tmp_path / "t.csv")
    assert m.f.tolist() == [[2.5, 2.5, 2.5]]
    np.testing.assert_allclose(m.wo[0, 0], np.sin(0.1), rtol=1e-6)


@pytest.mark.parametrize(
    "names",
    [
        "f_450nm,f_550nm,f_650nm",
        "f_450 nm (1/sr),f_550nm [1/sr],f_650nm(sr^-1)",
        '"F 450 [nm]","F 550 [nm]","F 650 [nm]"',
        "f450 (nm) [sr-1],f550 (nm) [sr-1],f650 (nm) [sr-1]",
    ],
)
def test_headers_of_spectra_with_units(tmp_path, names):
    """Three wavelengths and their order: red light is reflected most."""
    (tmp_path / "t.csv").write_text(f"theta_i,phi_i,theta_o,phi_o,{names}\n0,0,0.5,0,0.1,0.2,0.6\n")
    plain = tmp_path / "plain.csv"
    plain.write_text("theta_i,phi_i,theta_o,phi_o,f_450nm,f_550nm,f_650nm\n0,0,0.5,0,0.1,0.2,0.6\n")
    f = data.load(tmp_path / "t.csv").f[0]
    assert f.tolist() == data.load(plain).f[0].tolist() and f[0] > f[1] > f[2]


@pytest.mark.parametrize("suffix", [".txt", ".tsv"])
def test_suffixes_of_tables(tmp_path, suffix):
    (tmp_path / f"t{suffix}").write_text(RAD.replace(",", "\t"))
    assert len(data.load(tmp_path / f"t{suffix}").f) == 2


DEGREES = "30,90,60,-45,0.25\n"
IN_DEGREES = {
    "names": "theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,f\n" + DEGREES,
    "brackets": "theta_i [deg],phi_i [Degrees],theta_o (°),phi_o [°],f\n" + DEGREES,
    "by spaces": "theta_i [deg] phi_i [deg] theta_o [deg] phi_o [deg] f\n" + DEGREES.replace(",", " "),
    "line of units": "theta_i;phi_i;theta_o;phi_o;f\ndeg;deg;deg;deg;\n" + DEGREES.replace(",", ";"),
    "comment": "# all angles in degrees\ntheta_i,phi_i,theta_o,phi_o,f\n" + DEGREES,
    "comment below": "theta_i,phi_i,theta_o,phi_o,f\n% theta, phi: deg\n" + DEGREES,
    "one of each": f"theta_i_deg,phi_i_rad,theta_o_deg,phi_o_rad,f\n30,{np.pi / 2},60,{-np.pi / 4},0.25\n",
}


@pytest.mark.parametrize("way", IN_DEGREES)
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_degrees_where_the_table_says_so(tmp_path, way, encoding):
    (tmp_path / "t.csv").write_text(IN_DEGREES[way], encoding=encoding)
    m = data.load(tmp_path / "t.csv")
    np.testing.assert_allclose(m.wi, [[0, 0.5, np.sqrt(0.75)]], atol=1e-7)
    np.testing.assert_allclose(m.wo, [[np.sqrt(0.375), -np.sqrt(0.375), 0.5]], atol=1e-7)


ANGLES = "theta_i,phi_i,theta_o,phi_o,f\n"


@pytest.mark.parametrize(
    "text, message",
    [
        (
            ANGLES + "0.1,0,0.2,0,1\n57,0,30,0,1\n",
            r"theta_i in line 3 is 57, and 0 more .* no angle in radians\. .*_deg",
        ),
        (ANGLES + "0,0,0,270,1\n", r"phi_o in line 2 is 270.* no angle in radians"),
        (
            "theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,f\n200,0,0,0,1\n",
            "theta_i in line 2 is 200.* no angle in degrees, as the file",
        ),
        (
            "# angles in degrees\n" + ANGLES + "0.5,1,0.3,2,1\n",
            "a comment speaks of degrees, but all polar angles are at most 0.5",
        ),
        ("theta_i_deg,phi_i,theta_o_deg,phi_o,f\n9,9,9,9,1\n", "column phi_i names no unit, and other angles do"),
        ("theta_i,phi_i,theta_o,phi_o,f [%]\n", "line 1: column f is in '%'; known units are 1/sr"),
        ("theta_i [grad],phi_i,theta_o,phi_o,f\n", "line 1: column theta_i is in 'grad'; known units are rad, "),
    ],
    ids=["polar", "azimuth", "degrees", "comment", "some", "percent", "gradians"],
)
def test_angles_in_another_unit_are_refused(tmp_path, text, message):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        data.load(tmp_path / "t.csv")


def test_a_normal_that_is_not_z_warns(tmp_path):
    """With +y as the normal three quarters of all pairs have a z below 0."""
    rng = np.random.default_rng(1)
    v = rng.normal(size=(400, 2, 3))
    v[..., 1] = np.abs(v[..., 1])
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    np.savez(tmp_path / "t.npz", wi=v[:, 0], wo=v[:, 1], f=np.ones(400))
    with pytest.warns(UserWarning, match=r"of 400 rows have a direction below the horizon .* The normal must be \+z"):
        data.load(tmp_path / "t.npz")


HEADER = "wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,f_r,f_g,f_b\n"


@pytest.mark.parametrize(
    "text, message",
    [
        (HEADER + "0,0,1,0,0,1,1,1,1\n0,0,1,0,0,1,1,nan,1\n", r"line 3 has nan in column f_g"),
        ("# x\n\n" + HEADER + "0,0,1,0,0,1,1,inf,1\n", r"line 4 has inf in column f_g"),
        (HEADER + "0,0,1,0,0,1,1,1,1\n0,0,1,0,0,1.1,1,1,1\n", r"wo in line 3 has length 1.1, not 1"),
        (HEADER + "0,0,1,0,0,1,1,1e39,1\n", r"line 2 has 1e\+39 in column f_g"),
        (HEADER + "0,0,1,0,0,-1,1,1,1\n", "no row has both directions above the horizon"),
        (HEADER + "0,0,1,0,0,1,1,x,1\n", "line 2: 'x' in column f_g is no number"),
        (HEADER + "0,0,1,0,0,1,1,1,1\n0,0,1,0,0,1,1,,1\n", "line 3: '' in column f_g is no number"),
        (HEADER + "0,0,1,0,0,1,1,1\n", "line 2 has 8 cells under 9 column names: '0,0,1"),
        (ANGLES + "0,1,0,0,0,5,0,0,0,1\n", "line 2 has 10 cells under 5 .* decimal commas, .* by semicolons"),
        (
            ANGLES.replace(",", ";") + "0.1;0;0.1;0;1\n0,1;0;0.1;0;1\n",
            "line 2 has a decimal point, one in line 3 a comma",
        ),
        (HEADER, r"no numbers below the header in line 1\. .* commas, semicolons, tabs or spaces"),
        ("wi_x,wi_y,wi_z,f\n0,0,1,1\n", "Line 1 is 'wi_x,wi_y,wi_z,f'. Missing in it: wo_x, wo_y, wo_z"),
        ("0.1,0,0.5,3,0.1\n", "no line names the columns. Line 1 holds numbers already"),
        (ANGLES.replace("phi_o", "theta_o") + "0,0,0,0,1\n", "Missing in it: phi_o"),
        ("f," + ANGLES + "1,0,0,0,0,1\n", "the column f stands there twice"),
        ("", "The file is empty. Expected is one line of column names"),
        (ANGLES + "0.1,0,1,0,1_000\n", "line 2: '1_000' in column f is no number"),
        ("polar,azimuth,x\n0.1,0,0.5\n", "no line names the columns. Line 1 is 'polar,azimuth,x'"),
        ("<html>not found</html>", "no line names the columns. Line 1 is '<html>"),
        ("x" * 100_000, "line 1 is longer than 65536 characters"),
    ],
    ids=(
        "nan inf huge unit horizon word hole short decimal mixed none missing nameless double twice empty underscore "
        "other html long"
    ).split(),
)
def test_what_is_wrong_is_named(tmp_path, text, message):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        data.load(tmp_path / "t.csv")


@pytest.mark.parametrize("f", [np.array([0.5]), np.array([[0.5]]), np.array([[0.5, 0.5, 0.5]]), np.array([1])])
def test_npz_takes_grey(tmp_path, f):
    np.savez(tmp_path / "t.npz", wi=[[0, 0, 1]], wo=[[0, 0.6, 0.8]], f=f)
    assert data.load(tmp_path / "t.npz").f.tolist() == [[f.flat[0]] * 3]


@pytest.mark.parametrize(
    "arrays, message",
    [
        ({"f": np.ones(2)}, r"f is float64 with shape \(2,\); .* or, for grey, \(N,\)"),
        ({"wo": np.ones(3)}, r"wo is float64 with shape \(3,\)"),
        ({"wi": np.zeros((0, 3))}, r"wi is float64 with shape \(0, 3\)"),
    ],
    ids=["f", "wo", "empty"],
)
def test_npz_blames_the_right_array(tmp_path, arrays, message):
    np.savez(tmp_path / "t.npz", **{"wi": [[0, 0, 1.0]], "wo": [[0, 0, 1.0]], "f": [[1.0, 1, 1]], **arrays})
    with pytest.raises(ValueError, match=message):
        data.load(tmp_path / "t.npz")


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_a_changed_table_is_read_or_refused(tmp_path, seed):
    path = tmp_path / "t.csv"
    path.write_bytes(table_mutations.mutated(np.random.default_rng(seed)))
    assert table_mutations.outcome(path) in ("read", "refused")


def test_the_changes_reach_behind_the_header(tmp_path):
    """A fair part of the tables is read, and what refuses the others is not always the same."""
    path, read, reasons = tmp_path / "t.csv", 0, set()
    for seed in range(200):
        path.write_bytes(table_mutations.mutated(np.random.default_rng(seed)))
        try:
            data.load(path)
            read += 1
        except (ValueError, UserWarning) as error:
            reasons.add(re.sub(r"[\d\"']\S*", "", str(error).split(": ", 1)[1])[:20])
    assert read > 20 and len(reasons) > 10
