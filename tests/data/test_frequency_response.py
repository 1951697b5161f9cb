"""Frequency responses as files and as python-control's FRD."""

from pathlib import Path

import control
import numpy as np
import pytest

from sysid.data.frequency_response import FrequencyResponse, read_frequency_response
from sysid.data.record import Channel
from sysid.errors import DataError, SysidError

F = np.array([0.1, 1.0, 10.0])


def of_two_paths() -> FrequencyResponse:
    rng = np.random.default_rng(0)
    value = rng.standard_normal((3, 2, 2)) + 1j * rng.standard_normal((3, 2, 2))
    channels = (Channel("a, b", "µs"), Channel("v")), (Channel("left", "rad/s"), Channel("y"))
    gamma = rng.uniform(0.5, 1.0, (3, 2))
    return FrequencyResponse(F, value, np.abs(value) ** 2, *channels, 0.1, gamma)


def test_what_is_written_is_read_back_exactly(tmp_path: Path) -> None:
    one = of_two_paths()
    two = read_frequency_response(one.write(tmp_path / "x.frd.csv"))
    np.testing.assert_array_equal(two.value, one.value)
    np.testing.assert_array_equal(two.frequency, one.frequency)
    np.testing.assert_array_equal(two.coherence, one.coherence)
    assert two.variance is not None
    assert one.variance is not None
    np.testing.assert_allclose(two.variance, one.variance, rtol=1e-15)
    assert (two.inputs, two.outputs, two.sample_time) == (one.inputs, one.outputs, 0.1)


@pytest.mark.parametrize(
    "text",
    [
        "f,real,imag\n1,0,2\n2,-1,0\n",
        "f [Hz];magnitude;phase\n1;2;90\n2;1;180\n",
        "w,mag [dB],phase [rad]\n6.283185307179586,6.020599913279624,1.5707963267948966\n"
        "12.566370614359172,0,3.141592653589793\n",
        "# analyser\nFrequency [Hz],Magnitude_dB,Phase_deg\n1,6.020599913279624,90\n2,0,-180\n",
    ],
)
def test_what_analysers_write(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.frd.csv").write_text(text)
    found = read_frequency_response(tmp_path / "x.frd.csv")
    np.testing.assert_allclose(found.frequency, [1.0, 2.0], rtol=1e-14)
    np.testing.assert_allclose(found.value[:, 0, 0], [2j, -1.0], atol=1e-14)
    assert found.variance is None


def test_coherence_gives_the_error(tmp_path: Path) -> None:
    """√((1 − 0.8) / (0.8 · 5)) of the gain, 2: 0.447."""
    (tmp_path / "x.frd.csv").write_text("# windows: 5\nf,real,imag,coherence\n1,0,2,0.8\n")
    found = read_frequency_response(tmp_path / "x.frd.csv")
    assert found.variance is not None
    assert np.sqrt(found.variance[0, 0, 0]) == pytest.approx(2.0 * np.sqrt(0.05))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("f,real,imag\n", "no rows"),
        ("t,real,imag\n1,2,3\n", "first column is 't'"),
        ("f,real\n1,2\n", "needs real and imag"),
        ("f,real,imag\n1,2\n", "line 2: 2 cells"),
        ("f,real,imag\n1,2,x\n", "line 2: 'x' is no number"),
        ("f,real,imag\n2,2,1\n1,2,1\n", "number 2 does not"),
        ("f,real,imag\n1,nan,1\n", "line 2: a number is not finite"),
        ("f,mag [dB],phase\n1,1e6,0\n", "not finite"),
        ('f,real,imag"\n1,2,3\n', "is no part"),
        ('f,real,"imag\n1,2,3\n', "no rows"),
        ("f,speed\n1,2\n", "'speed' is no part"),
        ("f,u > y real,u > y imag,v > z real,v > z imag\n1,1,1,1,1\n", "u > z is missing"),
        ("# windows: 0\nf,real,imag,coherence\n1,1,1,1\n", "above 0"),
    ],
)
def test_what_cannot_be_read(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "x.frd.csv").write_text(text)
    with pytest.raises(DataError, match=words):
        read_frequency_response(tmp_path / "x.frd.csv")


@pytest.mark.parametrize("dt", [0, 0.1, 1.0])
def test_control_takes_it_and_gives_it_back(dt: float) -> None:
    plant = control.tf([1.0], [0.5, 1.0], dt)
    w = np.geomspace(0.1, 3.0, 20)
    given = FrequencyResponse.from_control(control.frequency_response(plant, w))
    np.testing.assert_allclose(given.value[:, 0, 0], plant(np.exp(1j * w * dt) if dt else 1j * w))
    again = FrequencyResponse.from_control(given.to_control())
    np.testing.assert_array_equal(again.value, given.value)
    np.testing.assert_allclose(again.w, w, rtol=1e-15)
    assert again.sample_time == (dt or None)
    two = of_two_paths()
    np.testing.assert_array_equal(FrequencyResponse.from_control(two.to_control()).value, two.value)


def test_damaged_files_end_in_a_sentence(tmp_path: Path) -> None:
    """Letters changed, lost or put in: read, or refused, never a traceback or a warning."""
    rng = np.random.default_rng(0)
    path = of_two_paths().write(tmp_path / "x.frd.csv")
    whole, put = path.read_bytes(), [b"1e308", b"nan", b'"', b"\n", b",", b"\x00", b">", b"[", b";"]
    refused = 0
    for _ in range(300):
        at, length = int(rng.integers(len(whole))), int(rng.integers(0, 3))
        path.write_bytes(whole[:at] + put[int(rng.integers(len(put)))] + whole[at + length :])
        try:
            read_frequency_response(path)
        except SysidError:
            refused += 1
    assert 0 < refused < 300
