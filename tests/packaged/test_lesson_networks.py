"""The small networks of lessons 08, 09 and 12: what each lacks, how large it is, who made it."""

import tomllib

import pytest
import torch

import dancediff as dd
from dancediff import nb
from dancediff.hub import packaged_models
from dancediff.metrics.swaps import final_order
from dancediff.nb import NETWORKS
from places import CONFIGS

LACKS = {
    "tcdiffpp_complete": (),
    "tcdiffpp_no_ssm": ("ssm",),
    "tcdiffpp_no_swap_mode": ("swap_mode",),
    "tcdiffpp_no_footwork_adaptor": ("footwork_adaptor",),
}
REFINES = {"lodge_complete": True, "lodge_no_foot_refine": False}


def test_these_are_all():
    assert {path.name for path in NETWORKS.iterdir()} == {*LACKS, *REFINES}
    assert not {*LACKS, *REFINES} & set(packaged_models())  # users are not offered them


@pytest.mark.parametrize("name", LACKS)
def test_a_network_lacks_the_part_of_its_name(name):
    assert nb.network(name).config.without == LACKS[name]


@pytest.mark.parametrize("name", REFINES)
def test_a_lodge_has_its_block_or_not(name):
    assert nb.network(name).config.local_stage.foot_refine is REFINES[name]


@pytest.mark.parametrize("name", [*LACKS, *REFINES])
def test_a_network_is_small_and_its_card_says_how_it_was_made(name):
    folder = NETWORKS / name
    sizes = [path.stat().st_size for path in folder.glob("*.safetensors")]
    assert sizes and max(sizes) < 2_000_000  # Lodge has a file for each stage
    card = (folder / "card.md").read_text(encoding="utf-8")
    config = CONFIGS / ("ablate_lessons_lodge.toml" if name in REFINES else "ablate_lessons.toml")
    assert f"dancediff ablate configs/{config.name}" in card
    variant = name.partition("_")[2].replace("no_", "no-")
    assert variant in tomllib.loads(config.read_text(encoding="utf-8"))["variants"]


@pytest.mark.parametrize("lacking", LACKS)
def test_but_for_the_part_the_networks_are_built_alike(lacking):
    sizes = [nb.network(name).config for name in ("tcdiffpp_complete", lacking)]
    assert len({(c.d_model, c.num_layers, c.ff_dim, c.fusion_hidden) for c in sizes}) == 1


def test_only_the_one_that_learned_with_s_changes_places():
    """As in lesson 09; ten minutes of training bring no more than most of the six."""
    how = {"dancers": 3, "seconds": 5, "steps": 10, "guidance": 1}
    how |= {"swap": (2, 1, 0), "order_constraint": False, "collision_avoidance": False}
    kept = {}
    for name in ("tcdiffpp_complete", "tcdiffpp_no_swap_mode"):
        network = nb.network(name)
        dances = [network.generate(dd.packaged_song(), seed=k, **how) for k in range(6)]
        kept[name] = sum(final_order(dance.root) == (2, 1, 0) for dance in dances)
    assert kept["tcdiffpp_complete"] >= 3
    assert kept["tcdiffpp_no_swap_mode"] == 0


def test_the_same_seed_gives_the_same_dance():
    how = {"dancers": 2, "seconds": 2, "steps": 4, "seed": 3}
    first, again = (
        nb.network("tcdiffpp_no_ssm").generate(dd.packaged_song(), **how) for _ in range(2)
    )
    torch.testing.assert_close(first.pose, again.pose, rtol=0, atol=0)


def test_an_unknown_name_is_answered_with_all_there_are():
    with pytest.raises(ValueError, match=r"name='no-ssm' .* there are .*tcdiffpp_no_ssm"):
        nb.network("no-ssm")
