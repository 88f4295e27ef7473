#!/bin/sh
# Makes a table of planners of others beside hmap's: tools/bench_peers.sh VENV PYTHON [OPTIONS of `hmap bench table`]
#   VENV: hmap's environment. PYTHON: makes environments for RAI (.venv-peers, which sees VENV, too) and for HPP (.venv-hpp).
# A peer that cannot be installed is left out, and the reason is said.
set -eu
venv=$1 python=$2
shift 2
planners="hmap komo lgp_star birrt"

# install ENVIRONMENT PACKAGES...
install() {
    environment=$1
    shift
    test -x "$environment/bin/python" || "$python" -m venv "$environment"
    "$environment/bin/pip" --disable-pip-version-check install --quiet --only-binary :all: "$@"
}

if install .venv-peers --no-deps robotic==0.4.2; then
    # addsitedir: also what the packages of VENV add to the path, such as hmap itself and coal
    packages=$("$venv/bin/python" -c "import site; print(site.getsitepackages()[0])")
    echo "import site; site.addsitedir('$packages')" \
        > "$(.venv-peers/bin/python -c "import site; print(site.getsitepackages()[0])")/hmap_peers.pth"
    if .venv-peers/bin/python -c "import robotic" 2> /dev/null; then
        planners="$planners rai_komo rai_lgp_star"
    else
        echo "bench-peers: without rai_komo and rai_lgp_star: robotic 0.4.2 needs the system's liblapack3" >&2
    fi
else
    echo "bench-peers: without rai_komo and rai_lgp_star: robotic 0.4.2 cannot be installed here (see above)" >&2
fi
if install .venv-hpp hpp-python==9.0.2 hpp-manipulation==9.0.2; then
    HMAP_HPP_PYTHON=$(pwd)/.venv-hpp/bin/python
    export HMAP_HPP_PYTHON
    planners="$planners hpp_manipulation"
else
    echo "bench-peers: without hpp_manipulation: hpp-manipulation 9.0.2 cannot be installed here (see above)" >&2
fi
case $planners in *rai*) python=.venv-peers/bin/python ;; *) python=$venv/bin/python ;; esac
# shellcheck disable=SC2086  # one word for each planner
exec "$python" -m hmap_core bench table --planners $planners --out peers "$@"
