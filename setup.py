"""Puts the configs of trainings into a wheel, beside the code; pyproject.toml says all else."""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithConfigs(build_py):
    """Copies configs/ to dancediff/configs/; an editable install reads them where they are."""

    def run(self):
        """Copy the code, then the configs."""
        super().run()
        if not self.editable_mode:
            target = Path(self.build_lib) / "dancediff" / "configs"
            target.mkdir(parents=True, exist_ok=True)
            for config in sorted(Path("configs").glob("*.toml")):
                self.copy_file(str(config), str(target / config.name))


setup(cmdclass={"build_py": BuildWithConfigs})
