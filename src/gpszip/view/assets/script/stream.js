/**
 * The stream of a live page: server-sent events, connected again whenever they break off.
 *
 * @typedef {"connecting" | "live" | "lost"} Connection
 */

/** Seconds without a message after which the connection is taken for lost; one comes every 2 s. */
const SILENCE_SECONDS = 10;

/** Milliseconds until a stream that was refused is asked for again. */
const RETRY_MILLISECONDS = 3000;

/** Milliseconds between two looks at the connection. */
const LOOK_MILLISECONDS = 1000;

/**
 * Address of a file of the server, without a user and password that the page's own may have: with
 * them, browsers refuse to ask.
 * @param {string} name
 */
export function addressOf(name) {
  const { origin, pathname, search } = window.location;
  return new URL(name + search, origin + pathname).href;
}

/**
 * Listen to the stream.
 * @param {Record<string, (data: any) => void>} listeners by the kind of message
 * @param {(state: Connection) => void} tell called when the connection changes
 */
export function listenToStream(listeners, tell) {
  /** @type {EventSource} */
  let source;
  let heard = Date.now();

  const connect = () => {
    heard = Date.now();
    source = new EventSource(addressOf("stream"));
    for (const [kind, listener] of Object.entries(listeners)) {
      source.addEventListener(kind, ({ data }) => {
        heard = Date.now();
        tell("live");
        listener(JSON.parse(data));
      });
    }
    source.addEventListener("error", () => tell("lost"));
  };
  connect();

  // A browser connects again by itself, unless the server refused it, or nobody hangs up.
  let closed = 0;
  setInterval(() => {
    const isClosed = source.readyState === EventSource.CLOSED;
    closed = isClosed ? closed + LOOK_MILLISECONDS : 0;
    const isSilent = Date.now() - heard > SILENCE_SECONDS * 1000;
    if (isSilent) tell("lost");
    if (closed < RETRY_MILLISECONDS && !isSilent) return;
    closed = 0;
    source.close();
    connect();
  }, LOOK_MILLISECONDS);
}
