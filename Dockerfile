# The parts that need no screen: rollout, eval, export, collect, train, and render by a software driver.
#
#   docker build -t robert .
#   docker run --rm -v "$PWD:/work" robert rollout fire --out fire.mcap
FROM rust:1.95-bookworm AS build
# The Debian release fixes the versions of these packages.
# hadolint ignore=DL3008
RUN apt-get update \
 && apt-get install -y --no-install-recommends g++ libmujoco-dev \
 && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY . .
RUN cargo build --release --locked && strip target/release/robert

FROM debian:12-slim
# hadolint ignore=DL3008
RUN apt-get update \
 && apt-get install -y --no-install-recommends libmujoco2.2.2 mesa-vulkan-drivers \
 && rm -rf /var/lib/apt/lists/* \
 && useradd --create-home --uid 1000 robert
COPY --from=build /src/target/release/robert /usr/local/bin/robert
COPY --from=build /src/LICENSE-MIT /src/LICENSE-APACHE /src/NOTICE /usr/share/doc/robert/
USER 1000
WORKDIR /work
ENTRYPOINT ["robert"]
CMD ["--help"]
