# Two stages: the first builds the binary, the second runs it as a user without rights.
# By hand the same steps are: cargo build --release --locked && target/release/riskaware
FROM rust:1.95-bookworm AS build
WORKDIR /build
COPY Cargo.toml Cargo.lock ./
COPY benches benches
COPY migrations migrations
COPY src src
COPY static static
COPY studies studies
COPY templates templates
RUN cargo build --release --locked --bin riskaware

FROM debian:bookworm-slim
RUN useradd --system --uid 10001 --home-dir /data riskaware \
    && install -d -o riskaware -g riskaware /data
COPY --from=build /build/target/release/riskaware /usr/local/bin/riskaware
USER riskaware
VOLUME /data
ENV RISKAWARE_DATABASE=/data/riskaware.db RISKAWARE_LISTEN=0.0.0.0:8080
EXPOSE 8080
# The program asks its own health route: the image needs no curl.
HEALTHCHECK --interval=30s --timeout=3s --start-period=5s CMD ["riskaware", "health"]
ENTRYPOINT ["riskaware"]
