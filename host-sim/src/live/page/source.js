// Source of events: this file, or the server that sent the page; and destination of commands.

class Source {
  constructor(take, connection) {
    this.take = take;
    this.connection = connection;
    this.token = location.hash.slice(1);
    const kept = document.getElementById('events');
    this.isFile = kept !== null;
    if (this.isFile) {
      const lines = kept.textContent.split('\n').filter(line => line.trim());
      take(lines.map(line => JSON.parse(line)));
      connection('a report', false);
    }
  }

  // The server's description of what it shows; nothing for a file.
  async about() {
    if (this.isFile) return null;
    if (!this.token) {
      this.connection('open the whole address that was printed, with what follows #', true);
      return null;
    }
    const answer = await fetch('about?token=' + encodeURIComponent(this.token));
    if (!answer.ok) {
      this.connection('this address is not the one that was printed last', true);
      return null;
    }
    return answer.json();
  }

  listen() {
    const stream = new EventSource('events?token=' + encodeURIComponent(this.token));
    let batch = [];
    stream.onopen = () => this.connection('connected', false);
    stream.onerror = () => {
      this.connection('the server does not answer; what is shown was before', true);
      // A server that came back has another token, and refuses this one for good.
      if (stream.readyState === EventSource.CLOSED) setTimeout(() => this.listen(), 2000);
    };
    stream.onmessage = message => {
      batch.push(JSON.parse(message.data));
      if (batch.length === 1) {
        setTimeout(() => { const events = batch; batch = []; this.take(events); }, 30);
      }
    };
  }

  async send(command) {
    try {
      const answer = await fetch('command', {
        method: 'POST', headers: {'content-type': 'application/json', 'x-token': this.token},
        body: JSON.stringify(command),
      });
      return answer.ok ? 'sent' : `refused: ${await answer.text() || answer.status}`;
    } catch {
      return 'the server does not answer';
    }
  }
}
