// @ts-check
/** The websocket to the server: questions and answers, and a new connection after the server was restarted. */

const PAUSE = 1000; // ms between tries to connect again

export class Connection {
  /**
   * @param {string} desk of the server that answers
   * @param {(open: boolean, connection: Connection) => void} onChange told when the connection opens or is lost
   */
  constructor(desk, onChange) {
    this.desk = desk;
    this.onChange = onChange;
    this.count = 0;
    /** @type {Map<number, {resolve: (answer: any) => void, reject: (error: Error) => void, onPart: (part: any) => void}>} */
    this.waiting = new Map();
    /** @type {WebSocket | null} */
    this.socket = null;
    this.closed = false;
    this.open();
  }

  open() {
    const address = new URL(`socket/${this.desk}`, location.href);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    this.socket = socket;
    socket.addEventListener("open", () => this.onChange(true, this));
    socket.addEventListener("message", (event) => this.receive(event.data));
    socket.addEventListener("close", () => {
      for (const { reject } of this.waiting.values()) reject(new Lost());
      this.waiting.clear();
      if (this.closed) return;
      this.onChange(false, this);
      if (!this.closed) setTimeout(() => this.open(), PAUSE);
    });
  }

  /** For good: whatever is under way stops. */
  close() {
    this.closed = true;
    this.socket?.close();
  }

  get ready() {
    return this.socket !== null && this.socket.readyState === WebSocket.OPEN;
  }

  /**
   * @param {string} ask
   * @param {object} fields
   * @param {(part: any) => void} onPart given parts of the answer that come before it
   * @returns {Promise<any>} the answer; rejected with the server's one-line error
   */
  ask(ask, fields = {}, onPart = () => {}) {
    return new Promise((resolve, reject) => {
      if (!this.socket || !this.ready) {
        reject(new Lost());
        return;
      }
      const id = ++this.count;
      this.waiting.set(id, { resolve, reject, onPart });
      this.socket.send(JSON.stringify({ id, ask, ...fields }));
    });
  }

  /** @param {string} text */
  receive(text) {
    const { id, answer, error, part } = JSON.parse(text);
    const asked = this.waiting.get(id);
    if (part !== undefined) {
      asked?.onPart(part);
      return;
    }
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
