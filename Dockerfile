# camcal in a container:
#   docker build -t camcal .
#   docker run --rm -v "$PWD:/data" camcal checkerboard pictures -o camera.yaml
FROM python:3.12-slim AS build
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY camcal camcal
RUN pip wheel --no-cache-dir --wheel-dir /wheels '.[report]'

FROM python:3.12-slim
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels \
    pip install --no-cache-dir --no-index --find-links /wheels 'camcal[report]' \
    && useradd --create-home camcal
USER camcal
WORKDIR /data
ENTRYPOINT ["camcal"]
CMD ["--help"]
