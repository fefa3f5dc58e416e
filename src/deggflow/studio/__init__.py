"""The studio: a page on this machine on which requirements are edited by hand and scenes follow at once.

`deggflow studio` starts a server (`server`) for pages that know its token (`access`). A page and the server exchange
messages over one websocket (`conversation`); what the server makes of a message is a task's (`tabletop`).
"""
