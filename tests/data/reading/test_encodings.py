"""Texts of the time before Unicode: the encoding is guessed by letters, said, and overruled."""

import re
from pathlib import Path

import pytest

from sysid.data.io import read_file
from sysid.data.reading.decoding import legacy
from sysid.data.reading.read_options import ReadOptions
from sysid.data.schema import checked
from sysid.errors import DataError, UsageError

TEXTS = {
    "cp1252": [
        "Zeit (s);Öffnung (%);Temperatur (°C)",
        "Ölmenge;Größe;Maßstab µm/s²",
        "temps;débit (m³/h);température à l'entrée",
        "tid;ström;läge på båten",
        "tiempo;señal;posición",
        "t;u [µs];y [°]",
        "t;Ø [mm];Übergänge",
    ],
    "cp932": [
        "時刻;バルブ開度指令;水温",
        "日付;電圧;回転速度",
        "時間;入力;出力 (℃)",
        "測定;モータ電流;荷重",
        "時刻;ソレノイド;変位",
    ],
    "euc-kr": ["시간;밸브 개도;온도", "시각;전압;회전 속도", "측정;입력;출력"],
    "gb2312": ["时间;阀门开度;温度", "时刻;电压;转速", "测量;输入;输出", "序号;流量;液位"],
    "big5": ["時間;閥門開度;溫度", "時刻;電壓;轉速"],
    "cp1251": ["время;напряжение;скорость", "Время;Ток якоря;Частота вращения"],
}
CASES = [(e, text) for e, texts in TEXTS.items() for text in texts]
ROWS = "\n".join(f"{k * 0.1:.1f};{k % 7};{k % 5}" for k in range(60))


@pytest.mark.parametrize(("encoding", "text"), CASES)
def test_the_encoding_is_guessed_by_its_letters(encoding: str, text: str) -> None:
    assert legacy(f"{text}\n{ROWS}\n".encode(encoding)) == encoding


@pytest.mark.parametrize(("encoding", "text"), CASES)
def test_a_guess_is_a_decision_and_the_option_says_the_same(
    encoding: str, text: str, tmp_path: Path
) -> None:
    path = tmp_path / "l.csv"
    path.write_bytes(f"{text}\n{ROWS}\n".encode(encoding))
    _, u, y = (re.split(r" [(\[]", name)[0] for name in text.split(";"))
    options = {"inputs": u, "outputs": y, "ts": 0.1}
    guessed = read_file(path, ReadOptions(**options))
    said = {d.what: (d.value, d.fields) for d in guessed.records[0].read_as}
    assert said["text"] == (f"in {encoding}", ("encoding",))
    given = read_file(path, ReadOptions(**options, encoding=encoding))
    assert given.records[0].input_names == guessed.records[0].input_names
    assert "text" not in {d.what for d in given.records[0].read_as}


def test_an_encoding_that_cannot_be(tmp_path: Path) -> None:
    for encoding in ("klingon", "hex", ""):
        with pytest.raises(UsageError, match="unknown `encoding`"):
            ReadOptions(encoding=encoding)
    assert ReadOptions(encoding="utf-16-le").encoding == "utf-16-le"
    path = tmp_path / "l.csv"
    path.write_bytes(f"t;u [µ];y\n{ROWS}\n".encode("cp1252"))
    with pytest.raises(DataError, match="not a text in utf-8"):
        read_file(path, ReadOptions(encoding="utf-8"))
    with pytest.raises(ValueError, match="encoding: it should be"):
        checked(ReadOptions, {"encoding": 5})
