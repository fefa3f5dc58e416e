// @ts-check
/** The websocket to the server: questions and answers, and a new connection after the server was restarted. */

const PAUSE = 1000; // ms between tries to connect again

export class Connection {
  /**
   * @param {(open: boolean) => void} onChange told when the connection opens or is lost
   */
  constructor(onChange) {
    this.onChange = onChange;
    this.count = 0;
    /** @type {Map<number, {resolve: (answer: any) => void, reject: (error: Error) => void}>} */
    this.waiting = new Map();
    /** @type {WebSocket | null} */
    this.socket = null;
    this.open();
  }

  open() {
    const address = new URL("socket", location.href);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    this.socket = socket;
    socket.addEventListener("open", () => this.onChange(true));
    socket.addEventListener("message", (event) => this.receive(event.data));
    socket.addEventListener("close", () => {
      for (const { reject } of this.waiting.values()) reject(new Lost());
      this.waiting.clear();
      this.onChange(false);
      setTimeout(() => this.open(), PAUSE);
    });
  }

  get ready() {
    return this.socket !== null && this.socket.readyState === WebSocket.OPEN;
  }

  /**
   * @param {string} ask
   * @param {object} fields
   * @returns {Promise<any>} the answer; rejected with the server's one-line error
   */
  ask(ask, fields = {}) {
    return new Promise((resolve, reject) => {
      if (!this.socket || !this.ready) {
        reject(new Lost());
        return;
      }
      const id = ++this.count;
      this.waiting.set(id, { resolve, reject });
      this.socket.send(JSON.stringify({ id, ask, ...fields }));
    });
  }

  /** @param {string} text */
  receive(text) {
    const { id, answer, error } = JSON.parse(text);
    const asked = this.waiting.get(id);
    this.waiting.delete(id);
    if (error === undefined) asked?.resolve(answer);
    else if (asked) asked.reject(new Error(error));
    else for (const { reject } of this.waiting.values()) reject(new Error(error));
    if (id === null) this.waiting.clear();
  }
}

/** The server is gone; the page says so anyway. */
export class Lost extends Error {
  constructor() {
    super("The studio does not answer.");
  }
}
