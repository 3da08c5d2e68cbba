import pytest

from dancediff import hub


@pytest.fixture(autouse=True, scope="module")
def no_packaged_weights():
    """Unit tests must not depend on what the packaged models have learned."""

    whole = hub._read

    def read(folder, *own):
        if hub.ASSETS in folder.parents:
            raise AssertionError("a test with packaged weights belongs in tests/packaged")
        return whole(folder, *own)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hub, "_read", read)
        yield
