# docker build -t jumpvision . && docker run --rm -v "$PWD:/data" jumpvision run /data/my_jumps --results /data/results
FROM python:3.12-slim
COPY . /src
# av's wheel brings x264 and x265, under the GPL: the notice and the offer of their source go with the image
RUN mkdir -p /usr/share/doc/jumpvision && cp /src/pipelines/packaging/*.txt /src/LICENSE /usr/share/doc/jumpvision/ \
    && pip install --no-cache-dir "/src[hdf5,plan]" && rm -rf /src
# any user, also one without a home; compiled code is kept in /tmp of the container
WORKDIR /data
ENTRYPOINT ["jumpvision"]
