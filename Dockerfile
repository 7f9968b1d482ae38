# syntax=docker/dockerfile:1
# Vantage's server. Build: docker build -t vantage .
# Run: docker run --stop-timeout 35 -p 8080:8080 -v vantage-data:/data -e VANTAGE_SERVER__API_KEY="$(openssl rand -hex 24)" vantage

FROM rust:1.95-slim-bookworm AS build
WORKDIR /src
# Dependencies alone first: they stay cached until the manifest or the lock file changes.
COPY Cargo.toml Cargo.lock ./
COPY src/Cargo.toml src/
COPY .cargo .cargo
RUN mkdir -p tests/it \
    && echo 'fn main() {}' > src/main.rs \
    && cp src/main.rs tests/it/main.rs \
    && cp src/main.rs build.rs \
    && touch src/core.rs src/lib.rs \
    && cargo build --locked --release \
    && rm -r src tests
COPY . .
# Commit for `vantage --version`: docker build --build-arg VANTAGE_COMMIT=$(git rev-parse HEAD) …
ARG VANTAGE_COMMIT=
# The stand-ins above are older than what they stand for only by chance: say that the sources are new.
RUN touch build.rs src/core.rs src/main.rs src/lib.rs \
    && cargo build --locked --release --bin vantage \
    && install -D -m 0755 target/release/vantage /out/usr/local/bin/vantage \
    && install -d /out/data

FROM debian:bookworm-slim
LABEL org.opencontainers.image.title="vantage" \
      org.opencontainers.image.description="Plans automated 3D scans" \
      org.opencontainers.image.licenses="MIT OR Apache-2.0"
COPY --from=build --chown=65532:65532 /out/ /
COPY --chown=65532:65532 LICENSE-MIT LICENSE-APACHE /usr/share/doc/vantage/
USER 65532:65532
VOLUME ["/data"]
EXPOSE 8080
STOPSIGNAL SIGTERM
# Large allocations in huge pages where the host offers them on request (glibc 2.35 or later): large parts are planned in less time.
ENV GLIBC_TUNABLES=glibc.malloc.hugetlb=1
# A large database takes minutes to open; a success before the period ends counts at once.
HEALTHCHECK --interval=15s --timeout=5s --start-period=10m --retries=3 \
    CMD ["/usr/local/bin/vantage", "healthcheck", "--url", "http://127.0.0.1:8080"]
# Listens on every address of the container, which the program refuses without a bearer key: give it in the environment.
ENTRYPOINT ["/usr/local/bin/vantage"]
CMD ["serve", "--listen", "0.0.0.0:8080", "--data", "/data"]
