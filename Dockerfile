# A listener for phones, robots, vehicles and boats: see docs/live.md.
#     docker build -t gpszip .
#     docker run -v positions:/data -p 127.0.0.1:8085:8085 -e GPSZIP_TOKEN gpszip
FROM python:3.13-slim

COPY . /src
RUN pip install --no-cache-dir '/src[live,mavlink,kafka,encrypted]' tzdata && rm -rf /src

# Compiled code is kept in the home of a user who can't write beside the package.
RUN useradd --create-home gpszip && mkdir /data && chown gpszip /data
USER gpszip
RUN gpszip warm

VOLUME /data
EXPOSE 8085
STOPSIGNAL SIGTERM
ENTRYPOINT ["gpszip"]
CMD ["listen", "--journal", "/data/journal", "--http", "0.0.0.0:8085"]
