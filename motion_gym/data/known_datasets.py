"""The data sets that motion-gym knows: their files with checksums, their sources and their terms of use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from motion_gym.data.scene_images import check_image
from motion_gym.data.sdd_files import CLIPS, read_annotations


@dataclass(frozen=True)
class DataFile:
    """One file of a data set.

    Attributes:
        name: Name in the folder of the data set.
        sha256: Checksum in hexadecimal; empty if the bytes are not known.
        size: Size in bytes; 0 if the bytes are not known.
        address: URL of the file; empty if it cannot be downloaded without an agreement.
        aliases: Other names, or ends of paths, under which the file is distributed.
        check: Called with the path and the content of a file whose bytes are not known; raises DataError.
    """

    name: str
    sha256: str
    size: int
    address: str
    aliases: tuple[str, ...] = ()
    check: Callable[[Path, bytes], object] | None = None


@dataclass(frozen=True)
class DataSet:
    """A data set: its files, their source and their terms of use; ``in_parts`` if some files are of use alone."""

    name: str
    title: str
    source: str
    terms: str
    citation: str
    files: tuple[DataFile, ...]
    in_parts: bool = False


# The folder, in a public repository and at a fixed commit, from which most of the field takes these files.
_TRAJECTRON = (
    "https://raw.githubusercontent.com/StanfordASL/Trajectron-plus-plus/"
    "40dec06e9cfef9e0d5f5ec69da2c4058a556bba9/experiments/pedestrians/raw/raw/all_data/"
)
_OPENTRAJ = (
    "https://raw.githubusercontent.com/crowdbotp/OpenTraj/3000c022dac1ecc2e34b3ff0fa2bb531151bf0b1/datasets/ETH/"
)
_ETH_UCY = (
    ("biwi_eth.txt", "cf8d3fd342a15f409ebc2a1fc76b91a0f06390bd21f1e11410f3859331ab082b", 116970),
    ("biwi_hotel.txt", "9caa771bb9153d6b809dd0916b6f86761b641e6bbb15e766c1de3133fbbb7fcf", 143799),
    ("crowds_zara01.txt", "1147a1962a09abfb86f28c6cddcac862e095a0cf129b3016385b69eacdd09d85", 205711),
    ("crowds_zara02.txt", "8a649d0f8c9ae75c87c4d23a85f892786b0aa30266e996c7be03e69dafff22ff", 392227),
    ("crowds_zara03.txt", "16b3e899932c4baacd07f45013d5b921f90bc5a29eb2b0fe42f4d7c904ac3108", 199834),
    ("students001.txt", "a6d87f278d94136fe39b8be91555487a29ac77259ae403b9dba2d5c18caf7b5b", 879714),
    ("students003.txt", "e25798b660634330aa89f8bb259425de720e84d0873902726c1d1f4ccff21d6c", 724279),
    ("uni_examples.txt", "61f432c0ab3070ed0ef150fbeabcd7baf839cab5495a46e6105bd747f0a092a7", 109307),
)


def _sdd_files() -> tuple[DataFile, ...]:
    """Files of both forms of the Stanford Drone Dataset, under the names of the data folder."""
    lines = Path(__file__).with_name("sdd_checksums.txt").read_text().splitlines()[1:]
    known = {name: (sha256, int(size)) for sha256, size, name in (line.split() for line in lines)}
    files = []
    for clip, (scene, video) in CLIPS.items():
        folder = f"{scene}/video{video}"
        for name, alias, check in (
            (f"raw/{folder}/annotations.txt", f"{folder}/annotations.txt", read_annotations),
            (f"reference/{clip}.jpg", f"{folder}/reference.jpg", check_image),
        ):
            files.append(DataFile(name, *known.pop(name, ("", 0)), "", (alias,), check))
    files += [DataFile(name, *bytes_of, "", (Path(name).name,)) for name, bytes_of in known.items()]
    return tuple(sorted(files, key=lambda file: file.name))


DATASETS: Mapping[str, DataSet] = {
    "eth_ucy": DataSet(
        name="eth_ucy",
        title="ETH-UCY: BIWI walking pedestrians (ETH) and crowds by example (UCY)",
        source=(
            "the text files first distributed with Social-GAN, in github.com/StanfordASL/Trajectron-plus-plus"
            " under experiments/pedestrians/raw/raw/all_data, and the original annotation of eth, in "
            "github.com/crowdbotp/OpenTraj under datasets/ETH/seq_eth/obsmat.txt"
        ),
        terms="UCY: free for use, as long as the authors give credit. ETH: none stated.",
        citation=(
            "Pellegrini, Ess, Schindler, van Gool: You'll never walk alone: modeling social behavior for "
            "multi-target tracking. ICCV 2009. Lerner, Chrysanthou, Lischinski: Crowds by example. Computer "
            "Graphics Forum 26(3), 2007."
        ),
        files=(
            *(DataFile(name, sha256, size, _TRAJECTRON + name) for name, sha256, size in _ETH_UCY),
            DataFile(
                "biwi_eth_obsmat_6frame.txt",
                "d452ae2185ecb1164c2fdf31e75f6236f4c2ffc02c751a6b2ae921740cbc60d1",
                1158040,
                _OPENTRAJ + "seq_eth/obsmat.txt",
                aliases=("obsmat.txt",),
            ),
        ),
    ),
    "sdd": DataSet(
        name="sdd",
        title="SDD: Stanford Drone Dataset, campus scenes seen from above",
        source=(
            "the annotation folders of cvgl.stanford.edu/projects/uav_data (SCENE/videoN/annotations.txt and "
            "reference.jpg); 20-step window tables in the form of Y-Net (windows/train.csv, test.csv, labels.csv); "
            "estimated_scales.yaml of OpenTraj; label maps of the scenes of Neural Social Physics (masks)"
        ),
        terms="CC BY-NC-SA 3.0: give credit, no commercial use, share alike.",
        citation=(
            "Robicquet, Sadeghian, Alahi, Savarese: Learning social etiquette: human trajectory understanding in "
            "crowded scenes. ECCV 2016."
        ),
        files=_sdd_files(),
        in_parts=True,
    ),
}
