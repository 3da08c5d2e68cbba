# Every target sets up .venv first if it is missing or out of date.
NEW    := -c "import sys; sys.exit(sys.version_info < (3, 11))"
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do \
                    $$p $(NEW) 2>/dev/null && echo $$p && break; done)
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
CPU    ?= https://download.pytorch.org/whl/cpu
TORCH  := $(shell sed -n 's/^\(torch==[0-9.]*\).*/\1/p' requirements.txt)
# Python compiles what is imported, once; compiling all that pip brings takes most of a minute.
PIP    := pip install --disable-pip-version-check -q --no-compile
export MPLBACKEND ?= Agg

.PHONY: setup dance quick test trust wheel mutants bench lint lab course slides docs player clean
setup: $(READY)

# The stamp is written last, so an interrupted set-up is done again. PyPI's PyTorch for Linux brings
# CUDA, several GB: without an NVIDIA GPU the small build is taken from PyTorch's own index first.
$(READY): pyproject.toml requirements.txt
	@"$(PYTHON)" $(NEW) 2>/dev/null || \
	  { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11"; exit 1; }
	@echo "Setting up $(VENV) with $(PYTHON): a few minutes, this once"
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV) || \
	  { rm -rf $(VENV); echo "no virtual environment; on Debian: apt-get install python3-venv"; exit 1; }
	@[ "$$(uname -s)" != Linux ] || command -v nvidia-smi >/dev/null 2>&1 || \
	  $(BIN)/python -m $(PIP) --no-deps --retries 1 --timeout 15 \
	    --index-url $(CPU) $(TORCH) 2>/dev/null || \
	  echo "$(CPU) did not answer: PyTorch comes from PyPI, with CUDA"
	$(BIN)/python -m $(PIP) -r requirements.txt
	$(BIN)/dancediff warm
	@touch $@

dance: $(READY)
	$(BIN)/dancediff generate packaged --dancers 3 --seconds 20 --seed 0 --out out
	@echo
	@echo "Watch out/dance.mp4, look at out/dance.png, load out/dance.npz with dancediff.Motion.load."
	@echo "Next: your own song     $(BIN)/dancediff generate SONG.mp3 --dancers 5 --out out"
	@echo "      the lessons       make lab"

# What to run while changing something, under three minutes on two idle cores: nothing slow, nothing
# that the packaged models have learned, no fuzzing, no browser, no lessons.
quick: export OMP_NUM_THREADS = 1
quick: $(READY)
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow" -o addopts=-q tests/identities \
	  tests/official_bugs tests/oracle tests/pages tests/paper tests/properties tests/structure tests/unit

# Two workers of one thread each; a notebook stays with one worker, and a dead kernel does not hang.
# A lesson runs as it is, and each of its exercises is solved in the same run after it was left open.
test: export OMP_NUM_THREADS = 1
test: $(READY)
	$(BIN)/python -m pytest -n 2 --dist loadfile
	rm -rf out/lessons && $(BIN)/python notebooks/student.py --both out/lessons
	$(BIN)/python -m pytest --nbval-lax --nbval-current-env --nbval-cell-timeout=120 \
	  -n 2 --dist loadfile -o addopts= out/lessons/

# The long form of the fuzz and trust tests, and what else one would rely on: properties of any
# input, licences, the doctor. What they found stands at the end.
trust: export OMP_NUM_THREADS = 1
trust: export DANCEDIFF_TRUST = long
trust: $(READY)
	$(BIN)/python -m pytest -n 2 --dist worksteal --timeout=1200 tests/trust tests/fuzz tests/properties \
	  tests/structure/test_licences.py tests/structure/test_packaging.py tests/packaged/test_doctor.py

# What one gets who has no checkout: the wheel in an environment of its own, used in an empty folder.
wheel: $(READY)
	bash .ci/wheel "$(PYTHON)" $(TORCH) $(CPU)

# Does a test fail where the code is wrong? Four minutes on two idle cores; goes on if it is stopped.
mutants: $(READY)
	$(BIN)/python benchmarks/mutants.py --json-file docs/results/mutants.json
	$(BIN)/python docs/site/tables.py

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

lab: $(READY)
	$(BIN)/jupyter lab notebooks/00_tour.ipynb

# A student's copy of the lessons, and the answers for the teacher.
course: $(READY)
	$(BIN)/python notebooks/student.py out/course
	$(BIN)/python notebooks/student.py --key out/key
	@echo "Hand out out/course; out/key has the answers, out/key/key.md on one page."

# A deck a lesson, from its texts and stored pictures; one file each, to be shown without a network.
slides: $(VENV)/.docs
	$(BIN)/python notebooks/slides.py out/slides
	@echo "Open out/slides/00_tour.html in a browser; arrow keys turn pages."

# Shows the outputs stored in the lessons and runs nothing. One resolve again, so PyTorch stays.
$(VENV)/.docs: $(READY)
	$(BIN)/python -m $(PIP) -r requirements.txt -e ".[docs]"
	@touch $@

docs: $(VENV)/.docs
	$(BIN)/python docs/site/gather.py out/docs-source
	$(BIN)/python -m sphinx -q -W --keep-going -j auto -c docs out/docs-source out/docs
	@echo "Open out/docs/index.html in a browser."

# How fast it is, in one table and out/speed.json; about ten minutes on idle cores.
bench: $(READY)
	$(BIN)/python benchmarks/speed.py --json out/speed.json

# The bundle is committed; this rebuilds it (needs node and npm).
player:
	cd src/dancediff/assets/player && npm install --no-package-lock --no-audit --no-fund && npm run build && rm -rf node_modules

clean:
	rm -rf $(VENV) out build
