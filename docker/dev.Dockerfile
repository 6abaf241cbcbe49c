# A place to work on ProACT: Debian 12 with what the build and the tests need, and a debugger. Editors that know dev
# containers use it through .devcontainer/devcontainer.json; by hand:
#
#   docker build -t proact-dev -f docker/dev.Dockerfile .
#   docker run --rm -it -v "$PWD":/work -w /work proact-dev ./proact test
FROM debian:12

ENV DEBIAN_FRONTEND=noninteractive
SHELL ["/bin/bash", "-o", "pipefail", "-c"]

# The launcher brings what it misses when it first runs; these spare the wait. Versions are those of the release.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        g++ make cmake pkg-config ca-certificates liborocos-kdl-dev libompl-dev libode-dev liburdfdom-dev \
        liburdfdom-headers-dev libfcl-dev libccd-dev libeigen3-dev libsqlite3-dev fonts-dejavu-core cargo-web rustc-web rustfmt-web rust-web-clippy \
        nodejs npm git gdb valgrind shellcheck clangd chromium python3-venv less procps \
    && rm -rf /var/lib/apt/lists/*
ENV DEBIAN_FRONTEND=

CMD ["/bin/bash"]
