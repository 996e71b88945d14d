# betterbench with its locked packages and software rendering: docker build -t betterbench .
FROM python:3.12-slim-bookworm AS build

WORKDIR /build
COPY requirements/bootstrap.lock requirements/
RUN pip install --no-cache-dir --require-hashes --no-deps -r requirements/bootstrap.lock
COPY pyproject.toml README.md LICENSE ./
COPY requirements/peer-libero.lock requirements/world-calvin.lock requirements/
COPY src src
RUN pip wheel --no-cache-dir --no-deps --no-build-isolation --wheel-dir /wheels .

FROM python:3.12-slim-bookworm

RUN apt-get update \
    && apt-get install -y --no-install-recommends libegl1 libgl1 \
    && rm -rf /var/lib/apt/lists/*
# The packages before the wheel, so that a change of the source does not install them again.
COPY requirements/runtime.lock /tmp/
RUN pip install --no-cache-dir --require-hashes --no-deps --only-binary :all: -r /tmp/runtime.lock
COPY --from=build /wheels /tmp/wheels
RUN pip install --no-cache-dir --no-deps /tmp/wheels/*.whl

RUN useradd --create-home better && mkdir -p /data/runs && chown -R better /data
USER better
WORKDIR /data
ENV MUJOCO_GL=egl LP_NUM_THREADS=0 OMP_NUM_THREADS=1
ENTRYPOINT ["better"]
CMD ["--help"]
